"""Finite-element models: matrices, functions, and reduced bases."""

from bayes_ssi.finite_elements.function_structure import FunctionStructure
from bayes_ssi.finite_elements.matrix_files import read_matrix
from bayes_ssi.finite_elements.matrix_structure import MatrixStructure
from bayes_ssi.finite_elements.reduced_structure import ReducedStructure

__all__ = ["FunctionStructure", "MatrixStructure", "ReducedStructure", "read_matrix"]
