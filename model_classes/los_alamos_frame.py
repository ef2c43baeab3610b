"""A three-storey laboratory frame on rails, tested in nine states with known changes.

Four plates, of which the lowest slides on rails, joined by four columns in each storey (Los Alamos
National Laboratory). Frequencies and states: Figueiredo et al. (LA-14393-MS, 2009,
doi 10.2172/961604), tables 2 and 4, the states without a bumper; masses and nominal column
stiffness: Dessena's model of the frame (doi 10.5281/zenodo.8406030). States 4 to 9 have one or two
columns of a storey of half of the thickness, an eighth of the stiffness. Shapes are not published
as numbers, and the first frequency, of the frame on its rails, is not given.

Does one factor serve all storeys, does each need its own, and do the frame's errors repeat?
"""

import bayes_ssi as bs

PLATES = (6.422, 6.565, 6.565, 6.675)  # kg, from the base, with accelerometers
COLUMN = 68_167.0  # N/m, nominal, of one of the four of a storey
RAILS = 1.0  # N/m: the base slides freely
BLOCK = 1.2  # kg
# State: frequencies in Hz, plate with a block, and the storey with thin columns and their number.
STATES = {
    "1": ((30.7, 54.2, 70.7), None, None),
    "2": ((30.4, 52.9, 70.3), 1, None),
    "3": ((30.9, 53.1, 68.2), 2, None),
    "4": ((30.9, 51.2, 69.2), None, (1, 1)),
    "5": ((30.3, 47.0, 67.8), None, (1, 2)),
    "6": ((29.7, 53.9, 65.8), None, (2, 1)),
    "7": ((28.6, 54.2, 62.2), None, (2, 2)),
    "8": ((30.2, 51.1, 69.3), None, (3, 1)),
    "9": ((28.9, 47.4, 68.0), None, (3, 2)),
}
PAIRING = {"2": 2, "3": 3, "4": 4}


def factor(name):
    return bs.Parameter(name, bs.LogNormal(median=1.5, cov=0.4))


def frame(state, factors):
    """The frame in one state; storey 1 of the model is the rails."""
    _, block, thin = STATES[state]
    columns = [4.0, 4.0, 4.0]
    if thin is not None:
        storey, number = thin
        columns[storey - 1] -= 0.875 * number
    masses = [mass + BLOCK * (plate == block) for plate, mass in enumerate(PLATES, 1)]
    springs = [number * COLUMN * each for number, each in zip(columns, factors, strict=True)]
    return bs.ShearBuilding(masses=masses, stiffnesses=[RAILS, *springs])


def modes(state):
    frequencies, *_ = STATES[state]
    identified = map(bs.IdentifiedMode, PAIRING, frequencies)
    return bs.ModalData(tuple(identified), (15.0, 100.0), source="LA-14393-MS, table 4")


def model_class(name, factors, error, description):
    return bs.ModelClass(
        name,
        configurations=[
            bs.Configuration(f"state {state}", frame(state, factors), modes(state), pairing=PAIRING)
            for state in STATES
        ],
        error=error,
        description=description,
    )


alike, each = [factor("k")] * 3, [factor(f"k{i}") for i in (1, 2, 3)]
independent = bs.ErrorModel()
repeated = bs.ErrorModel(between_tests=bs.Parameter("between tests", bs.Uniform(0.0, 1.0)))
study = bs.Study(
    "Three-storey frame of Los Alamos in nine states",
    [
        model_class("one factor", alike, independent, "one factor for all storeys"),
        model_class("each storey", each, independent, "a factor for each storey"),
        model_class("one factor, repeated", alike, repeated, "one factor, errors repeat"),
        model_class("each storey, repeated", each, repeated, "a factor each, errors repeat"),
    ],
    description="One factor for all storeys or one each, and do errors repeat from state to state?",
)
