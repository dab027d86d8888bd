# SPDX-License-Identifier: Apache-2.0
"""The vocabulary: similar features are one word, and the file is what DBoW2 reads."""

import numpy as np

from experiments.drivers.train_vocabulary import BYTES, as_text, distances, part, train

RANDOM = np.random.default_rng(7)
KINDS = RANDOM.integers(0, 256, (9, BYTES), dtype=np.uint8)
"""Nine kinds of features, 128 bits apart on average."""


def noisy(kind: int) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """A feature of a kind, with a few bits of other value."""
    bits = np.unpackbits(KINDS[kind])
    bits[RANDOM.choice(8 * BYTES, 6, replace=False)] ^= 1
    return np.packbits(bits)


def test_distances_are_numbers_of_bits() -> None:
    a = np.zeros((2, BYTES), np.uint8)
    a[1, :2] = 0xFF, 0x01
    assert distances(a, a).tolist() == [[0, 9], [9, 0]]


def test_features_of_a_kind_come_into_one_group() -> None:
    kinds = np.repeat(np.arange(9), 30)
    features = np.stack([noisy(kind) for kind in kinds])
    middles, groups = part(features, 9, np.random.default_rng(1))
    assert len({(int(k), int(g)) for k, g in zip(kinds, groups, strict=True)}) == 9
    assert sorted(distances(KINDS, middles).min(axis=1)) == [0] * 9, "majority restores each"


def test_parents_come_first_and_words_are_what_has_no_children() -> None:
    kinds = np.tile(np.repeat(np.arange(9), 10), 4)
    features = np.stack([noisy(kind) for kind in kinds])
    nodes = train(features, np.repeat(np.arange(4), 90), words=3, levels=2)
    numbers = range(1, len(nodes) + 1)
    assert all(node.parent < number for number, node in zip(numbers, nodes, strict=True))
    parents = {node.parent for node in nodes}
    assert [number not in parents for number in numbers] == [node.is_word for node in nodes]
    assert sum(node.is_word for node in nodes) == 9, "three groups of three"


def test_what_is_in_few_pictures_weighs_more() -> None:
    features = np.stack([noisy(kind) for kind in [0] * 40 + [1] * 40])
    pictures = np.concatenate([np.arange(40), np.full(40, 7)])
    words = [n for n in train(features, pictures, words=2, levels=1) if n.is_word]
    assert sorted(round(node.weight, 6) for node in words) == [0.0, round(np.log(40), 6)]


def test_the_text_has_a_line_for_each_node_and_no_newline_at_its_end() -> None:
    features = np.stack([noisy(kind) for kind in range(9)] * 5)
    nodes = train(features, np.arange(45), words=3, levels=2)
    head, *lines = as_text(nodes, 3).split("\n")
    assert head == "3 6 0 0"
    assert len(lines) == len(nodes)
    for line, node in zip(lines, nodes, strict=True):
        parent, is_word, *middle, weight = line.split(" ")
        assert (int(parent), int(is_word)) == (node.parent, int(node.is_word))
        assert list(map(int, middle)) == node.middle.tolist()
        assert float(weight) == float(f"{node.weight:.6g}")
