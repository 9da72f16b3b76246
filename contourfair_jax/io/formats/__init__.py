"""One module for each kind of file; `contourfair_jax.io._table` has their rows."""
