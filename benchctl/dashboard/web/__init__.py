"""The live page over HTTP: who may ask, what is answered, and how much of it at once.

`server` runs `app` on a socket; `connections` limits connections below HTTP, `gate` checks each request. `access`
knows who asks. The answers are made by `benchctl.dashboard.data`, in the threads of `answers`; `rooms` sends the state
of a run to everybody who watches it.
"""
