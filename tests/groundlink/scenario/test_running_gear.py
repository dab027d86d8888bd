# SPDX-License-Identifier: Apache-2.0
"""What drives take, what they refuse, and which wheels turn together."""

from typing import Any

import msgspec
import pytest

from groundlink.scenario.vehicle import VehicleModel


def wheel(name: str, x: float, y: float, **fields: Any) -> dict[str, Any]:
    figures = {"radius_m": 0.2, "width_m": 0.1, "mass_kg": 5.0}
    return {"name": name, "center_m": [x, y, 0.0], **figures, **fields}


FOUR = [
    wheel("front_left", 0.5, 0.4),
    wheel("front_right", 0.5, -0.4),
    wheel("rear_left", -0.5, 0.4),
    wheel("rear_right", -0.5, -0.4),
]
TWO_AND_A_CASTER = [*FOUR[:2], wheel("ball", -0.5, 0.0, caster=True)]
LIMITS = {"max_wheel_torque_nm": 10.0, "max_wheel_speed_radps": 10.0}
STEERED = ["front_left", "front_right"]


def model(kind: str, wheels: list[dict[str, Any]], **fields: Any) -> VehicleModel:
    document = {
        "name": "it",
        "chassis": {"mass_kg": 50.0, "size_m": [1.0, 0.6, 0.3]},
        "suspension": {},
        "wheels": wheels,
        "drive": {"kind": kind, **LIMITS, **fields},
    }
    return msgspec.convert(document, VehicleModel)


@pytest.mark.parametrize(
    ("it", "driven", "counted"),
    [
        (model("skid_steer", FOUR), [w["name"] for w in FOUR], [w["name"] for w in FOUR]),
        (model("differential", TWO_AND_A_CASTER), STEERED, STEERED),
        (model("tracked", FOUR), ["left_track", "right_track"], ["left_track", "right_track"]),
        (
            model("ackermann", FOUR, steered=STEERED),
            ["rear_left", "rear_right"],
            ["rear_left", "rear_right"],
        ),
        (
            model("ackermann", FOUR, steered=STEERED, driven="front"),
            STEERED,
            ["rear_left", "rear_right"],
        ),
        (
            model("ackermann", FOUR, steered=STEERED, driven="all"),
            [w["name"] for w in FOUR],
            ["rear_left", "rear_right"],
        ),
    ],
)
def test_driven_and_counted_wheels(it: VehicleModel, driven: list[str], counted: list[str]) -> None:
    shafts = it.drive.shafts(it.wheels)
    assert [shaft.name for shaft in shafts if shaft.driven] == driven
    assert [shaft.name for shaft in it.counted] == counted


def test_wheels_of_a_track_share_a_shaft_of_the_sprockets_radius() -> None:
    left, right = model("tracked", FOUR, sprocket_radius_m=0.1, belt_mass_kg=3.0).counted
    assert (left.wheels, right.wheels) == ((0, 2), (1, 3))
    assert left.radius_m == 0.1
    assert left.inertia_kgm2 == pytest.approx(0.03)


def test_only_those_that_steer_need_room_to_turn() -> None:
    assert model("tracked", FOUR).least_radius_m == 0.0
    car = model("ackermann", FOUR, steered=STEERED, max_steering_deg=45.0)
    assert car.least_radius_m == pytest.approx(1.0 + 0.4)


@pytest.mark.parametrize(
    ("kind", "wheels", "fields", "says"),
    [
        ("skid_steer", TWO_AND_A_CASTER, {}, "`ball` is a caster, which only a `differential`"),
        ("differential", FOUR, {}, "two driven wheels, not 4"),
        ("differential", [FOUR[0], FOUR[2]], {}, "both sides"),
        ("tracked", TWO_AND_A_CASTER, {}, "no casters"),
        ("tracked", FOUR[:3], {}, "two road wheels or more on each side"),
        ("ackermann", FOUR, {"steered": ["front_left", "front"]}, "no wheel `front`"),
        ("ackermann", FOUR, {"steered": ["rear_left", "rear_right"]}, "is not in front of"),
        ("ackermann", FOUR, {}, "missing required field `steered`"),
        ("skid_steer", [*FOUR, FOUR[0]], {}, "two `wheels` have the same name"),
        ("skid_steer", [*FOUR[:3], wheel("light", -0.5, -0.4, mass_kg=0.5)], {}, "damper of"),
        (
            "skid_steer",
            [
                *FOUR[:3],
                wheel("w", -0.5, -0.4, suspension={"stiffness_npm": 1e6, "damping_nspm": 1.0}),
            ],
            {},
            "spring of `w` is too stiff .* at most 800000",
        ),
        ("hover", FOUR, {}, "hover"),
        ("skid_steer", FOUR, {"max_wheel_torque_nm": 0.0}, "max_wheel_torque_nm"),
    ],
)
def test_what_cannot_be_is_refused(
    kind: str, wheels: list[dict[str, Any]], fields: dict[str, Any], says: str
) -> None:
    with pytest.raises(msgspec.ValidationError, match=says):
        model(kind, wheels, **fields)


def test_a_wheel_that_is_held_above_the_ground_does_not_stand() -> None:
    idler = {**wheel("idler", 0.9, 0.4), "center_m": [0.9, 0.4, 0.1]}
    it = model("tracked", [*FOUR, idler])
    assert [it.stands_on(w) for w in it.wheels] == [True] * 4 + [False]
    assert it.base_height_m == pytest.approx(0.2)


def test_inertia_that_no_body_has_is_refused() -> None:
    plain = msgspec.to_builtins(model("skid_steer", FOUR))
    plain["chassis"]["inertia_kgm2"] = [1.0, 2.0, 3.0]
    assert msgspec.convert(plain, VehicleModel).chassis.inertia_kgm2 == (1.0, 2.0, 3.0)
    plain["chassis"]["inertia_kgm2"] = [1.0, 2.0, 3.5]
    with pytest.raises(msgspec.ValidationError, match="above the sum of the others"):
        msgspec.convert(plain, VehicleModel)
