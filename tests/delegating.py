"""A structure that delegates to another one; tests override the part that they examine."""

from bayes_ssi.structures.structure import Structure


class DelegatingStructure(Structure):
    """Another structure, without its description."""

    def __init__(self, structure):
        self.structure = structure

    @property
    def parameters(self):
        return self.structure.parameters

    @property
    def degrees_of_freedom(self):
        return self.structure.degrees_of_freedom

    @property
    def n_modes(self):
        return self.structure.n_modes

    def modes(self, values):
        return self.structure.modes(values)
