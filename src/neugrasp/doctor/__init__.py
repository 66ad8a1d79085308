"""Looking at a capture before anything is predicted from it.

A check measures one thing and gives a `Finding`; each has a row in docs/troubleshooting.md, which is
generated. What costs little and decides runs before every prediction (`examine_read`), the rest with
`neugrasp doctor`.
"""
