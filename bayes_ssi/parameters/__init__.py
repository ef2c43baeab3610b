"""Prior distributions F: proper, and maps value = F⁻¹(Φ(z)) of standard-normal coordinates z."""
