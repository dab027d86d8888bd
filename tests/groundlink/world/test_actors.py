# SPDX-License-Identifier: Apache-2.0
import numpy as np

from groundlink.world.actors import PersonForm, form_solids
from groundlink.world.bounds import bounds


def test_a_person_twice_as_tall_is_twice_as_large_in_every_direction() -> None:
    small, large = (
        PersonForm(height_m=height, shirt="a", trousers="a", skin="a") for height in (1.0, 2.0)
    )
    boxes = [np.array([bounds(part) for part in form_solids(person)]) for person in (small, large)]
    np.testing.assert_allclose(2 * boxes[0], boxes[1], atol=1e-9)
