"""Where is the part? Candidates for a first pose, from one image and the prepared part, without a guess.

Coarse to fine: oriented edges, a scan of view templates over an image pyramid, a pose search on directional distance
maps, and evidence that is checked in both directions. Refining by alignment is above: `tracking.find`.
"""
