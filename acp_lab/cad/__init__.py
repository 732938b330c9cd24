"""The CAD model: reading it, casting rays at it, its edges, and a picture of it."""
