"""How fast, how large: times beside peers and floors, memory."""
