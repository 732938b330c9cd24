"""Sources of generated edges inside one frame: t(I) of a rigid generator, or read off a painted edge image."""
