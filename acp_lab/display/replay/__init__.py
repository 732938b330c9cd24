"""Runs as rerun recordings: written while they run, read again, compared, shown and filmed.

`recorder.Replay` is the observer that writes; `log`, `object_log`, `images`, `curves`, `columns` and `clock` are how;
`parts` turns CAD models into lines and meshes; `blueprint` arranges the viewer. `file` reads and merges recordings,
`frames` takes their frames out, `overlay_video` makes a film of them, `viewer` shows runs in a notebook.
"""
