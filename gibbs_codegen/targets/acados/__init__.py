"""acados: the dynamics as its C interface links them."""
