"""How good: errors, contours, surfaces, seams, noise, holes."""
