"""The live page over HTTP: authentication, routes and limits.

`server` runs `app` on a socket; `connections` limits connections below HTTP, `gate` checks each request. `access`
authenticates the client. The responses are created by `benchctl.dashboard.data`, in the threads of `answers`; `rooms`
sends the state of a run to all its viewers.
"""
