"""A structure that answers by another one: what tests change of it is all that they say."""

from bayes_ssi.structures import Structure


class Behind(Structure):
    """Another structure, without its description."""

    def __init__(self, building):
        self.building = building

    @property
    def parameters(self):
        return self.building.parameters

    @property
    def degrees_of_freedom(self):
        return self.building.degrees_of_freedom

    @property
    def n_modes(self):
        return self.building.n_modes

    def modes(self, values):
        return self.building.modes(values)
