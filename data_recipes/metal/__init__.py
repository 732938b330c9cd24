"""Synthetic sequences of metal parts: CAD parts, scene, motion, renderer and camera, one module each."""
