"""Why the tracker did badly in a frame.

`frame_evidence` measures what an image shows of the part, `causes` holds one limit and one sentence per cause, and
`diagnosis` puts both together for a frame of a run. `acp.explain` draws the result.
"""
