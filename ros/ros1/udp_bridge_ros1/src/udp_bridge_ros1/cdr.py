# SPDX-License-Identifier: Apache-2.0
"""Conversion between CDR and ROS 1's serialization, by a plan compiled once per message type.

A message is cut into slices, which are joined again. Only lengths are unpacked, so the cost of an
array of numbers does not depend on its length. Both formats are little-endian. They differ as
follows:

- CDR aligns each number to its own size, counted from the end of the encapsulation; ROS 1 packs;
- a string of CDR ends with a NUL, which is part of its length;
- a Header of ROS 1 begins with `seq`, which CDR lacks.

Fields that ROS 2 added at the end of a type are dropped, because ROS 1 does not have them.
"""

from __future__ import annotations

from struct import Struct
from typing import Dict, List, Sequence, Tuple, Union

from .definition import HEADER, Definition, Field, parse

Buffer = Union[bytes, bytearray, memoryview]

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Encapsulation header of little-endian CDR."""
_PRIMITIVES: Dict[str, Tuple[int, int]] = {
    **dict.fromkeys(("bool", "int8", "uint8", "byte", "char"), (1, 1)),
    **dict.fromkeys(("int16", "uint16"), (2, 2)),
    **dict.fromkeys(("int32", "uint32", "float32"), (4, 4)),
    **dict.fromkeys(("int64", "uint64", "float64"), (8, 8)),
    **dict.fromkeys(("time", "duration"), (4, 8)),
}
"""Alignment and size of each primitive."""
_LENGTH = Struct("<I")
_NO_SEQ = bytes(4)


class MalformedMessage(ValueError):
    """The bytes are not a valid message of the type."""


class _Written:
    """CDR output buffer."""

    def __init__(self) -> None:
        self.chunks: List[Buffer] = [ENCAPSULATION]
        self.at = 0
        """Number of bytes after the encapsulation."""

    def pad(self, count: int) -> None:
        self.put(bytes(count))

    def put(self, chunk: Buffer) -> None:
        self.chunks.append(chunk)
        self.at += len(chunk)


class _Fixed:
    """Step for consecutive numbers, including arrays of a fixed length."""

    def __init__(self, numbers: Sequence[Tuple[int, int]]) -> None:
        self._pieces = [_pieces(numbers, phase) for phase in range(8)]
        """For each start position modulo 8: pairs of padding and the number of bytes after it."""

    def to_ros1(self, cdr: memoryview, at: int, out: List[Buffer]) -> int:
        for padding, size in self._pieces[at & 7]:
            begin = at + padding
            at = _end(cdr, begin + size)
            out.append(cdr[begin:at])
        return at

    def to_cdr(self, ros1: memoryview, at: int, out: _Written) -> int:
        for padding, size in self._pieces[out.at & 7]:
            end = _end(ros1, at + size)
            out.pad(padding)
            out.put(ros1[at:end])
            at = end
        return at


class _Seq:
    """Step for the `seq` of a ROS 1 Header, which is set to 0."""

    def to_ros1(self, _: memoryview, at: int, out: List[Buffer]) -> int:
        out.append(_NO_SEQ)
        return at

    def to_cdr(self, ros1: memoryview, at: int, _: _Written) -> int:
        return _end(ros1, at + len(_NO_SEQ))


class _Text:
    """Step for a string."""

    def to_ros1(self, cdr: memoryview, at: int, out: List[Buffer]) -> int:
        length, at = _length(cdr, at + (-at & 3))
        end = _end(cdr, at + length)
        if length and cdr[end - 1]:
            raise MalformedMessage("a string does not end with NUL")
        size = max(0, length - 1)  # some writers omit the NUL of an empty string
        out += _LENGTH.pack(size), cdr[at : at + size]
        return end

    def to_cdr(self, ros1: memoryview, at: int, out: _Written) -> int:
        size, at = _length(ros1, at)
        end = _end(ros1, at + size)
        out.pad(-out.at & 3)
        out.put(_LENGTH.pack(size + 1))
        out.put(ros1[at:end])
        out.pad(1)
        return end


class _Numbers:
    """Step for a variable-length array of numbers, which is copied as one slice."""

    def __init__(self, alignment: int, size: int) -> None:
        self._mask, self._size = alignment - 1, size

    def to_ros1(self, cdr: memoryview, at: int, out: List[Buffer]) -> int:
        count, begin = _length(cdr, at + (-at & 3))
        out.append(cdr[begin - _LENGTH.size : begin])
        if not count:
            return begin
        begin += -begin & self._mask
        end = _end(cdr, begin + count * self._size)
        out.append(cdr[begin:end])
        return end

    def to_cdr(self, ros1: memoryview, at: int, out: _Written) -> int:
        count, begin = _length(ros1, at)
        end = _end(ros1, begin + count * self._size)
        out.pad(-out.at & 3)
        out.put(ros1[at:begin])
        if count:
            out.pad(-out.at & self._mask)
            out.put(ros1[begin:end])
        return end


class _Each:
    """Step for a variable-length array of other elements."""

    def __init__(self, steps: Sequence[_Step]) -> None:
        self._steps = steps

    def to_ros1(self, cdr: memoryview, at: int, out: List[Buffer]) -> int:
        count, at = _length(cdr, at + (-at & 3))
        out.append(_LENGTH.pack(count))
        for _ in range(count):
            for step in self._steps:
                at = step.to_ros1(cdr, at, out)
        return at

    def to_cdr(self, ros1: memoryview, at: int, out: _Written) -> int:
        count, at = _length(ros1, at)
        out.pad(-out.at & 3)
        out.put(_LENGTH.pack(count))
        for _ in range(count):
            for step in self._steps:
                at = step.to_cdr(ros1, at, out)
        return at


_Step = Union[_Fixed, _Seq, _Text, _Numbers, _Each]


class ConversionPlan:
    """Conversion plan for the messages of one type.

    Parameters
    ----------
    full_text
        Full ROS 1 definition of the type, see `definition.parse`.
    """

    def __init__(self, full_text: str) -> None:
        definition = parse(full_text)
        self.is_stamped = definition.fields[:1] == [Field(HEADER, None)]
        """Whether messages begin with a Header. If so, the first chunk of `to_ros1` is its `seq`.
        """
        self._steps = _compiled(definition.fields, definition)

    def to_ros1(self, cdr: Buffer) -> List[Buffer]:
        """Return the chunks of a ROS 1 message, most of them views of `cdr`; each `seq` is 0.

        Raises
        ------
        MalformedMessage
            When `cdr` is not a valid message of the type.
        """
        if bytes(cdr[:2]) != ENCAPSULATION[:2]:
            raise MalformedMessage("this is no little-endian CDR")
        body = memoryview(cdr)[len(ENCAPSULATION) :]
        chunks: List[Buffer] = []
        at = 0
        for step in self._steps:
            at = step.to_ros1(body, at, chunks)
        return chunks

    def to_cdr(self, ros1: Buffer) -> bytes:
        """Return a message as CDR, including the encapsulation.

        Raises
        ------
        MalformedMessage
            When `ros1` is not a valid message of the type.
        """
        body = memoryview(ros1)
        written = _Written()
        at = 0
        for step in self._steps:
            at = step.to_cdr(body, at, written)
        if at != len(body):
            raise MalformedMessage(f"{len(body) - at} bytes too many")
        return b"".join(written.chunks)


def _compiled(fields: Sequence[Field], definition: Definition) -> List[_Step]:
    """Return the steps for a list of fields; consecutive numbers are one step."""
    steps: List[_Step] = []
    numbers: List[Tuple[int, int]] = []
    for part in _flat(fields, definition):
        if isinstance(part, tuple):
            numbers.append(part)
            continue
        if numbers:
            steps.append(_Fixed(numbers))
            numbers = []
        steps.append(part)
    return [*steps, _Fixed(numbers)] if numbers else steps


def _flat(fields: Sequence[Field], definition: Definition) -> List[Union[_Step, Tuple[int, int]]]:
    """Return steps, and the alignment and size of each number between them."""
    parts: List[Union[_Step, Tuple[int, int]]] = []
    for type_name, count in fields:
        if type_name in _PRIMITIVES:
            alignment, size = _PRIMITIVES[type_name]
            if count == -1:
                parts.append(_Numbers(alignment, size))
            else:
                parts.append((alignment, size * (1 if count is None else count)))
        elif count is not None:
            one = [Field(type_name, None)]
            if count == -1:
                parts.append(_Each(_compiled(one, definition)))
            else:
                parts += _flat(one, definition) * count
        elif type_name == "string":
            parts.append(_Text())
        elif type_name == HEADER:
            parts += [_Seq(), *_flat(definition.parts[HEADER][1:], definition)]
        elif type_name in definition.parts:
            parts += _flat(definition.parts[type_name], definition)
        else:
            raise ValueError(f"the definition lacks the type {type_name}")
    return parts


def _pieces(numbers: Sequence[Tuple[int, int]], phase: int) -> List[Tuple[int, int]]:
    pieces: List[Tuple[int, int]] = []
    at = phase
    for alignment, size in numbers:
        padding = -at % alignment
        if padding or not pieces:
            pieces.append((padding, size))
        else:
            before, so_far = pieces[-1]
            pieces[-1] = (before, so_far + size)
        at += padding + size
    return pieces


def _length(data: memoryview, at: int) -> Tuple[int, int]:
    end = _end(data, at + _LENGTH.size)
    return _LENGTH.unpack_from(data, at)[0], end


def _end(data: memoryview, end: int) -> int:
    if end > len(data):
        raise MalformedMessage(f"it ends after {len(data)} bytes, within a field")
    return end
