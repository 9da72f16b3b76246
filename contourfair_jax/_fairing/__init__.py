"""From samples to a Bezier net; `method` is the interface, a method is one package beside it."""
