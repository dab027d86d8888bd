# SPDX-License-Identifier: Apache-2.0
"""Publishing of serialized bodies from the memory in which they were received.

rclpy publishes `bytes` only and copies them once more, while no other thread of Python runs. So the
C extension of `udp_bridge` passes the body's address to `rcl_publish_serialized_message`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from udp_bridge.io.native import batch_io

if TYPE_CHECKING:
    from udp_bridge.wire.header import Buffer


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
        function = None
    if function is None or batch_io is None:
        return lambda body: publisher.publish(bytes(body))
    address = ctypes.cast(function, ctypes.c_void_p).value
    handle = publisher.handle

    def publish(body: Buffer) -> None:
        with handle:  # it is not destroyed meanwhile
            code = batch_io.publish(address, handle.pointer, body)
        if code:
            raise RuntimeError(f"rcl_publish_serialized_message failed (code={code})")

    return publish
