"""What people look at: replays (rerun) and pictures (matplotlib). Both are observers of the frame loop."""
