# SPDX-License-Identifier: Apache-2.0
"""A vocabulary for ORB-SLAM3 from the pictures of a bag: `python train_vocabulary.py BAG OUT.txt`.

Runs in ORB-SLAM3's environment. ORB features of all pictures are clustered recursively (k-majority:
each bit of a cluster center is that of most members). The file is the text form of DBoW2: a line
with words, levels, scoring and weighting, then a line for each node: parent, whether it is a word,
32 bytes, weight. It has no newline at the end, which DBoW2 would take for another node.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

BYTES = 32
"""Of an ORB descriptor."""
ROUNDS = 10
"""At most, until groups stay as they are."""
L1_NORM, TF_IDF = 0, 0
"""DBoW2's numbers of how words are compared and weighted, which ORB-SLAM3 expects."""

ABOVE, GROUPING = 4, 2
"""ORB-SLAM3 compares features of two key frames where they share a node so many levels above the
deepest one. It is told of a tree in which that is the second level, however deep this one is: with
one of 4 levels it would compare all with all, and fall minutes behind in looking for loops."""


@dataclass
class Node:
    """A node of the tree; its number is its place in the list."""

    parent: int
    middle: Any
    is_word: bool
    weight: float


def main() -> None:
    """Read, part, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--image", default="/camera/image_raw/compressed")
    parser.add_argument("--words", type=int, default=10, help="of each node")
    parser.add_argument("--levels", type=int, default=4)
    parser.add_argument("--features", type=int, default=400, help="of each picture")
    options = parser.parse_args()
    descriptors, pictures = read(options)
    if len(descriptors) < options.words**2:
        sys.exit(f"{options.bag}: {len(descriptors)} features on {options.image}; expected many")
    nodes = train(descriptors, pictures, options.words, options.levels)
    options.out.write_text(as_text(nodes, options.words), encoding="ascii")
    words = sum(node.is_word for node in nodes)
    print(f"{words} words of {len(descriptors)} features in {pictures.max() + 1} pictures")


def read(options: argparse.Namespace) -> tuple[Any, Any]:
    """Return the descriptors of all pictures, shape (N, 32), and the picture of each."""
    orb = cv2.ORB.create(nfeatures=options.features)
    found, numbers = [], []
    with AnyReader([options.bag], default_typestore=get_typestore(Stores.ROS2_KILTED)) as bag:
        connections = [c for c in bag.connections if c.topic == options.image]
        for number, (connection, _, raw) in enumerate(bag.messages(connections)):
            message: Any = bag.deserialize(raw, connection.msgtype)
            gray: Any = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_GRAYSCALE)
            _, descriptors = orb.detectAndCompute(gray, None)
            if descriptors is not None:
                found.append(descriptors)
                numbers.append(np.full(len(descriptors), number))
    if not found:
        return np.empty((0, BYTES), np.uint8), np.empty(0, np.int64)
    return np.concatenate(found), np.concatenate(numbers)


def train(descriptors: Any, pictures: Any, words: int, levels: int) -> list[Node]:
    """Return all nodes but the root, parents first; parents are numbered from 1, the root is 0.

    Parameters
    ----------
    descriptors
        uint8, shape (N, 32).
    pictures
        shape (N,): from which picture each is. A word that is in n of m pictures weighs log(m / n).
    """
    random = np.random.default_rng(1)
    count = len(np.unique(pictures))
    nodes: list[Node] = []
    open_nodes = [(0, np.arange(len(descriptors)), 1)]
    while open_nodes:
        parent, members, level = open_nodes.pop(0)
        middles, groups = part(descriptors[members], words, random)
        for group, middle in enumerate(middles):
            inside = members[groups == group]
            is_word = level == levels or len(inside) <= words
            seen = len(np.unique(pictures[inside]))
            weight = float(np.log(count / seen)) if is_word and seen else 0.0
            nodes.append(Node(parent, middle, is_word, weight))
            if not is_word:
                open_nodes.append((len(nodes), inside, level + 1))
    return nodes


def part(descriptors: Any, words: int, random: np.random.Generator) -> tuple[Any, Any]:
    """Part descriptors into groups by k-majority.

    Returns
    -------
    The middle of each group, uint8, shape (K, 32), and the group of each descriptor.
    """
    different = np.unique(descriptors, axis=0)
    if len(different) <= words:
        return different, nearest(descriptors, different)
    middles = spread(different, words, random)
    bits = np.unpackbits(descriptors, axis=1)
    groups = nearest(descriptors, middles)
    for _ in range(ROUNDS):
        for group in range(words):
            inside = bits[groups == group]
            if len(inside):
                middles[group] = np.packbits(2 * inside.sum(axis=0, dtype=np.int64) > len(inside))
        again = nearest(descriptors, middles)
        if np.array_equal(again, groups):
            break
        groups = again
    return middles, groups


def spread(descriptors: Any, words: int, random: np.random.Generator) -> Any:
    """Return descriptors to begin with, far from each other (k-means++ by Hamming distance)."""
    chosen = [int(random.integers(len(descriptors)))]
    least = distances(descriptors, descriptors[chosen])[:, 0].astype(np.float64)
    while len(chosen) < words:
        share = least**2 / (least**2).sum()
        chosen.append(int(random.choice(len(descriptors), p=share)))
        least = np.minimum(least, distances(descriptors, descriptors[chosen[-1:]])[:, 0])
    return descriptors[chosen].copy()


def nearest(descriptors: Any, middles: Any) -> Any:
    """Return the number of the nearest middle of each descriptor."""
    return distances(descriptors, middles).argmin(axis=1)


def distances(descriptors: Any, middles: Any) -> Any:
    """Return Hamming distances, shape (N, K)."""
    a = np.ascontiguousarray(descriptors).view(np.uint64)
    b = np.ascontiguousarray(middles).view(np.uint64)
    return np.stack([np.bitwise_count(a ^ row).sum(axis=1) for row in b], axis=1)


def as_text(nodes: list[Node], words: int) -> str:
    """Return the text of a vocabulary."""
    lines = [f"{words} {GROUPING + ABOVE} {L1_NORM} {TF_IDF}"]
    lines += [
        f"{node.parent} {int(node.is_word)} {' '.join(map(str, node.middle))} {node.weight:.6g}"
        for node in nodes
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
