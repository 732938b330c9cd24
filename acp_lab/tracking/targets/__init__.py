"""What generated edges are compared with in a frame: a distance map, or image edges along their normals."""
