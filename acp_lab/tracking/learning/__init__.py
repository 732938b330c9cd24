"""What a tracker learns about its edge samples while it tracks: their look, their place, their reliability."""
