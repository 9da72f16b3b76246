"""The contour energy over the whole C1 space, with coherent normals."""
