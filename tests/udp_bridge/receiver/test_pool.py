# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge.receiver.pool import KEPT_BYTES, BlockPool, is_free


@pytest.fixture
def pool() -> BlockPool:
    return BlockPool()


def test_block_is_reused_when_unreferenced(pool: BlockPool) -> None:
    block = pool.lease(100_000)
    assert pool.lease(100_000) is block
    view = memoryview(block)[10:20].toreadonly()
    assert not is_free(block)
    other = pool.lease(100_000)
    assert other is not block
    view.release()
    assert pool.lease(100_000) in (block, other)
    assert is_free(block)


def test_the_block_that_was_used_last_is_used_next(pool: BlockPool) -> None:
    views = [memoryview(pool.lease(100_000)) for _ in range(3)]
    blocks = [view.obj for view in views]
    for view in views:
        view.release()
    assert pool.lease(100_000) is blocks[2]
    with memoryview(blocks[2]):
        assert pool.lease(100_000) is blocks[1]
    assert pool.lease(100_000) is blocks[1]


def test_the_check_for_views_changes_no_byte() -> None:
    block = bytearray(b"abc")
    assert is_free(block)
    assert block == b"abc"


@pytest.mark.parametrize("size", [1, 70_000, 16_700_000])
def test_a_block_is_large_enough_and_not_wasteful(size: int, pool: BlockPool) -> None:
    pool.lease(16_700_000)
    assert size <= len(pool.lease(size)) <= 2 * size + 65_536


def test_memory_is_bounded(pool: BlockPool) -> None:
    views = [memoryview(pool.lease(16_000_000)) for _ in range(6)]
    assert len({id(view.obj) for view in views}) == 6
    assert pool.kept_bytes <= KEPT_BYTES


def test_an_offered_block_is_taken_once_and_only_if_it_fits(pool: BlockPool) -> None:
    block = pool.offer(200_000)
    assert pool.offer(200_000) is block
    assert pool.lease(200_000) is not block
    assert pool.take_offered(bytearray(300_000), 200_000) is None
    assert pool.take_offered(block, 900_000) is None
    assert pool.take_offered(block, 200_000) is block
    assert pool.take_offered(block, 200_000) is None
