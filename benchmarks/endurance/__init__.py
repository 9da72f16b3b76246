"""How reliable, how large: tiles, killed runs, damaged files."""
