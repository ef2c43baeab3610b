"""A structure that delegates to another one; tests override the part that they examine."""

from bayes_ssi.structures.structure import Structure


class DelegatingStructure(Structure):
    """Another structure, without its description."""

    def __init__(self, structure):
        self.structure = structure

    parameters = property(lambda self: self.structure.parameters)
    degrees_of_freedom = property(lambda self: self.structure.degrees_of_freedom)
    n_modes = property(lambda self: self.structure.n_modes)

    def modes(self, values):
        return self.structure.modes(values)
