"""The live page over HTTP: who may ask, what is answered, and how much of it at once.

`server` runs `app` on a socket; `connections` bounds what comes in below HTTP, `gate` what comes in as a request.
`access` knows who asks. The answers are made by `benchctl.dashboard.data`, in the threads of `readers`; `live` sends
them on while a run goes.
"""
