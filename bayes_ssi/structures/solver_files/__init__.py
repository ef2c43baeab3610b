"""Models as finite-element programs export them: stiffness, mass, labels and coordinates."""
