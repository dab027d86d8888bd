# SPDX-License-Identifier: Apache-2.0
import fcntl
import os
import re
from pathlib import Path

import pytest

from udp_bridge_ros2.stale_shared_memory import MIN_AGE_S, SHARED_MEMORY, remove_leftovers

from .conftest import Ros

OLD = "fastdds_0123456789abcdef"
LOCK = re.compile("fastdds_[0-9a-f]{16}_el")
NOW_S = 1_000_000.0


def segment(folder: Path, name: str, *, age_s: float) -> Path:
    (folder / name).write_bytes(b"segment")
    lock = folder / f"{name}_el"
    lock.touch()
    os.utime(lock, (NOW_S - age_s, NOW_S - age_s))
    return lock


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_segment_without_an_owner_is_removed(tmp_path: Path) -> None:
    segment(tmp_path, OLD, age_s=MIN_AGE_S)
    assert remove_leftovers(tmp_path, now_s=NOW_S) == 1
    assert names(tmp_path) == set()


def test_what_may_be_in_use_stays(tmp_path: Path) -> None:
    held = segment(tmp_path, OLD, age_s=1000.0)
    segment(tmp_path, "fastdds_00000000deadbeef", age_s=MIN_AGE_S - 1)
    segment(tmp_path, "fastdds_port7410", age_s=1000.0)
    segment(tmp_path, "another_0123456789abcdef", age_s=1000.0)
    before = names(tmp_path)
    with held.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert remove_leftovers(tmp_path, now_s=NOW_S) == 0
    assert names(tmp_path) == before


def test_where_there_is_no_such_folder_nothing_happens(tmp_path: Path) -> None:
    assert remove_leftovers(tmp_path / "none", now_s=NOW_S) == 0


def is_held(lock: Path) -> bool:
    try:
        with lock.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except FileNotFoundError:  # of another process, which has ended meanwhile
        return False
    except BlockingIOError:
        return True
    return False


@pytest.mark.skipif(not SHARED_MEMORY.is_dir(), reason="no /dev/shm here")
def test_a_living_node_holds_the_lock_of_its_segment(ros: Ros) -> None:
    before = names(SHARED_MEMORY)
    ros.bridge()
    made = names(SHARED_MEMORY) - before
    assert any(is_held(SHARED_MEMORY / name) for name in made if LOCK.fullmatch(name))
