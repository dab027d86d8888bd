# SPDX-License-Identifier: Apache-2.0
"""World queries from ROS, passed to physics as they are. The gateway reads no query or answer."""

from collections.abc import Callable

import msgspec

from groundlink.core.errors import UserError
from udp_bridge.wire.header import BadMessage, Refused
from udp_bridge.wire.world_queries import WorldQuery, WorldReply, pack_text, unpack_text


def execute_world_query(ask: Callable[[bytes], bytes], query: WorldQuery) -> WorldReply:
    """Pass a query of the peer on; return the reply, also when there is no answer.

    Parameters
    ----------
    ask
        returns the answer of physics, or raises a UserError that says why there is none.
    """
    try:
        answer = pack_text(ask(unpack_text(query.packed_text).encode()).decode())
    except UserError as problem:
        answer = _failure(str(problem))
    except Refused as refused:
        answer = _failure(f"the query's text is refused: {refused.reason}")
    except BadMessage as problem:
        answer = _failure(f"the answer is too large for one datagram: {problem}")
    return WorldReply(query.number, answer)


def _failure(error: str) -> bytes:
    return pack_text(msgspec.json.encode({"error": error, "code": "failed"}).decode())
