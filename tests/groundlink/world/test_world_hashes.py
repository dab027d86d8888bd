# SPDX-License-Identifier: Apache-2.0
"""World hashes of the shipped scenarios: a change of the world builder must not change a world.

Where a change is intended, replace the table.
"""

import pytest

from groundlink.loader import load
from groundlink.scene.build import world_hash

HASHES = {
    "indoor_2d": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_depth": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_lab": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_lab_tour": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_paper": "60a9e84690f44261ec0211c42424049fef7bebb4cc041ab16e430746c45e59a8",
    "outdoor_paper": "2ec40249e6e9a06550968d502f26d024e1255623b999f54cced7d232b9a6d465",
    "scanned_room": "d26cf4b6a0c940f261f9da7c42093b037433b4cfcbe9d52bc535f38310e6e53b",
    "track": "eefa5a49168a514911b79c7ce4125ca3caae17d5df0a5c2667cc68eb15aeb7b7",
    "two_rovers": "19a61f6474fb1a19f4f6a48c763d7761553db65a8e546b35ae82a2b81182f4ba",
    "yard": "beb2269f674e360714411a23890a2026772d077c142af0f019bced5d08adbb87",
}


@pytest.mark.parametrize("name", HASHES)
def test_the_world_is_the_same_to_the_bit(name: str) -> None:
    assert world_hash(load(name)) == HASHES[name]
