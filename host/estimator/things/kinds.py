"""The columns of the PHD filter's state: a thing, and how likely it is a teammate or an obstacle.

A state is one array (STATE, n), a column for each component. Its first rows are two Gaussian
mixtures over the same n things, one for each kind; the weights of both together are how surely
the thing is there, their ratio is how surely it is a teammate.
"""

import numpy as np

from host.config import FilterSettings
from host.estimator.evidence import likeness
from host.estimator.gaussians.gaussian_mixture import PXX, ROWS, WEIGHT, X, Y
from host.messages import FloatArray, Positions

TEAMMATE, OBSTACLE = 0, 1
MIXTURE = slice(0, 2 * ROWS)  # of the state: the rows of both kinds, as (ROWS, 2, n)
# Then time of the last position reading (s), 1 if reported, its label (0 until it is reported),
# and the index of its parent: the component before the update that it comes from.
SEEN, CONFIRMED, LABEL, PARENT = range(2 * ROWS, 2 * ROWS + 4)
STATE = 2 * ROWS + 4


def rows_of(state: FloatArray) -> FloatArray:
    """The mixtures (ROWS, 2, n) of a state (STATE, n): by quantity, kind and component; a view."""
    # A view only of contiguous memory: so columns are picked by take, never by an index array.
    return state[MIXTURE].reshape(ROWS, 2, -1)


def existence(rows: FloatArray) -> FloatArray:
    """The weight (n,) of each thing, whatever its kind, from rows (ROWS, 2, n)."""
    return np.asarray(rows[WEIGHT, TEAMMATE] + rows[WEIGHT, OBSTACLE])


def born_at(measured: Positions, settings: FilterSettings, parent: int) -> FloatArray:
    """A component at each of m readings, with the intensity of birth as weight: (STATE, m)."""
    born = np.zeros((STATE, len(measured.positions)))
    rows = rows_of(born)
    rows[X], rows[Y] = measured.positions.T
    rows[PXX:WEIGHT] = measured.covariances.reshape(-1, 4).T.take((0, 1, 3), axis=0)[:, None]
    # What does not look like a turret is rather an obstacle. That it does is no evidence for a
    # teammate: what looks like one in this revolution, a post, does so in the next.
    teammate = (1.0 - settings.obstacle_share) * likeness(measured)
    rows[WEIGHT, TEAMMATE] = settings.birth_per_m2 * teammate
    rows[WEIGHT, OBSTACLE] = settings.birth_per_m2 * settings.obstacle_share
    born[SEEN], born[PARENT] = measured.time, parent
    return born
