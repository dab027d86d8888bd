# SPDX-License-Identifier: Apache-2.0
"""Publishing of serialized bodies from the memory in which they were received.

rclpy publishes `bytes` only and copies them once more, while no other thread of Python runs. So a
large body goes to `rcl_publish_serialized_message`, by the address of its buffer. The middleware
copies it before the call returns.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from udp_bridge.wire.header import Buffer

LARGE_BYTES = 1 << 14
"""Smaller bodies are copied, which takes less time than finding their address."""
_PYBUF_SIMPLE = 0


class _PyBuffer(ctypes.Structure):
    """`Py_buffer`, whose fields after the first three are not used."""

    _fields_ = (
        ("buf", ctypes.c_void_p),
        ("obj", ctypes.c_void_p),
        ("len", ctypes.c_ssize_t),
        ("rest", ctypes.c_void_p * 8),
    )


class _SerializedMessage(ctypes.Structure):
    """`rcl_serialized_message_t`."""

    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("buffer_length", ctypes.c_size_t),
        ("buffer_capacity", ctypes.c_size_t),
        ("allocator", ctypes.c_void_p * 5),
    )


_get_buffer = ctypes.pythonapi.PyObject_GetBuffer
_get_buffer.argtypes = (ctypes.py_object, ctypes.c_void_p, ctypes.c_int)
_release_buffer = ctypes.pythonapi.PyBuffer_Release
_release_buffer.argtypes = (ctypes.c_void_p,)
_release_buffer.restype = None


def serialized_publish(publisher: Any) -> Callable[[Buffer], None]:
    """Return a function that publishes a body in CDR, bytes or memoryview.

    Parameters
    ----------
    publisher
        A publisher of rclpy.
    """
    try:
        function = ctypes.CDLL("librcl.so").rcl_publish_serialized_message
    except (OSError, AttributeError):  # not this system's name of the library
        return lambda body: publisher.publish(bytes(body))
    function.argtypes = (ctypes.c_void_p,) * 3

    def publish(body: Buffer) -> None:
        if len(body) < LARGE_BYTES:
            publisher.publish(bytes(body))
            return
        view = _PyBuffer()
        _get_buffer(body, ctypes.addressof(view), _PYBUF_SIMPLE)
        try:
            message = _SerializedMessage(view.buf, view.len, view.len)
            with publisher.handle:  # it is not destroyed meanwhile
                code = function(publisher.handle.pointer, ctypes.addressof(message), None)
        finally:
            _release_buffer(ctypes.addressof(view))
        if code:
            raise RuntimeError(f"rcl_publish_serialized_message failed (code={code})")

    return publish
