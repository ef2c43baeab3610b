"""Prior distributions: proper, and written as transformations of a standard normal.

Sampling takes place in standard-normal coordinates ``z`` with
``value = F⁻¹(Φ(z))``, where ``F`` is the prior's distribution function. In these
coordinates every prior is N(0, I) and no sample can leave the prior's support.
"""
