"""The paper's method: every inner vertex fairs its own 3^d neighbourhood."""
