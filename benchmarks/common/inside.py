"""The engine's inside, for the benchmarks that time its stages or write it down once more.

The one module here that imports private names: what moves in the package is mended in one place.
"""

from contourfair_jax._bezier.bernstein import bernstein_derivative as bernstein_derivative
from contourfair_jax._bezier.bernstein import kronecker as kronecker
from contourfair_jax._bezier.bernstein import quadrature as quadrature
from contourfair_jax._bezier.nets import set_samples as set_samples
from contourfair_jax._fairing.global_fairing.cell_form import energy_form as energy_form
from contourfair_jax._fairing.global_fairing.cell_form import structure_form as structure_form
from contourfair_jax._fairing.global_fairing.cell_weights import Powers as Powers
from contourfair_jax._fairing.global_fairing.linear_system import LinearSystem as LinearSystem
from contourfair_jax._fairing.local_fairing.energy import LocalEnergy as LocalEnergy
from contourfair_jax._fairing.local_fairing.method import contour_tensors as contour_tensors
from contourfair_jax._fairing.local_fairing.method import division as division
from contourfair_jax._fairing.local_fairing.solvers import eliminate as eliminate
from contourfair_jax._fairing.local_fairing.solvers import substitute as substitute
from contourfair_jax._fairing.local_fairing.splines import TO_BEZIER as TO_BEZIER
from contourfair_jax._fairing.local_fairing.windows import neighbourhoods as neighbourhoods
from contourfair_jax._fairing.local_fairing.windows import scatter_patches as scatter_patches
from contourfair_jax._fairing.small_systems import batched as batched
from contourfair_jax._level_sets import even_levels as even_levels
from contourfair_jax._support.xla import apart as apart
from contourfair_jax.isosurface._mesh import edges_of as edges_of
