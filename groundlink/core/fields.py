# SPDX-License-Identifier: Apache-2.0
"""Field types that scenarios and messages share: `Spec`, bounded numbers, vectors, quaternions.

Plain data: each value serializes to the same bytes on every machine.
"""

from typing import Annotated

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Fraction01 = Annotated[float, Meta(ge=0, le=1)]
Vector3 = tuple[float, float, float]
Size3 = tuple[Positive, Positive, Positive]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w, unit length."""


class Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Part of a scenario: immutable; an unknown key is an error."""
