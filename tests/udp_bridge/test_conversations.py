# SPDX-License-Identifier: Apache-2.0
"""Random conversations: several senders with loss, restarts and forged Offers and Requests."""

from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from fuzz.conversation import (
    ANSWER_LOST,
    CLOCK_SHIFTS_NANOS,
    HELD,
    HONEST,
    LARGEST_BODY,
    LOST,
    SENDERS,
    TWICE,
    Conversation,
    Forgery,
)
from udp_bridge import MSG_TYPES
from udp_bridge.wire.header import NANOS
from udp_bridge.wire.repair import Offer, Request

INDEX = st.integers(0, SENDERS - 1)
FORGER = st.integers(1, SENDERS - 1)
NUMBER = st.sampled_from([0, 0, -1, -2, 1, 300, 1 << 30])
SECONDS = st.sampled_from([0, 0, -1, 1, 1 << 31])
PARTS = st.sampled_from([1, 2, 3, 30, 255])
PART = st.integers(0, 254)
SIZE = st.sampled_from([0, 500, 3000, LARGEST_BODY - 33])
ACTIONS = st.lists(st.sampled_from([0, 0, 0, LOST, LOST, TWICE, HELD, ANSWER_LOST]), min_size=5)


class Conversations(RuleBasedStateMachine):
    """Chooses the events; `Conversation` checks after each of them."""

    def __init__(self) -> None:
        super().__init__()
        self.conversation = Conversation()

    @rule(index=INDEX, size=SIZE, actions=ACTIONS)
    def send(self, index: int, size: int, actions: list[int]) -> None:
        self.conversation.send(index, size)
        self.conversation.transfer(index, actions)

    @rule(index=INDEX, actions=ACTIONS)
    def transfer(self, index: int, actions: list[int]) -> None:
        self.conversation.transfer(index, actions)

    @rule(index=INDEX, shift=st.integers(0, len(CLOCK_SHIFTS_NANOS) - 1))
    def restart(self, index: int, shift: int) -> None:
        self.conversation.restart(index, shift)

    @rule(ms=st.sampled_from([0, 1, 5, 50, 600, 2500]))
    def wait(self, ms: int) -> None:
        self.conversation.wait(ms)

    @rule(sender=FORGER, number=NUMBER, seconds=SECONDS, parts=PARTS, part=PART)
    def forge_part(self, sender: int, number: int, seconds: int, parts: int, part: int) -> None:
        body = bytes(8)
        self.conversation.forge(Forgery(sender, 1, number, seconds, part, parts, "/p", body))

    @rule(sender=FORGER, number=NUMBER, seconds=SECONDS, parts=PARTS)
    def forge_offer(self, sender: int, number: int, seconds: int, parts: int) -> None:
        body = Offer(1, parts, 500).pack()
        self.conversation.forge(Forgery(sender, 65, number, seconds, 0, 1, "/p", body))

    @rule(sender=FORGER, number=NUMBER, parts=PARTS, part=PART)
    def forge_request(self, sender: int, number: int, parts: int, part: int) -> None:
        body = Request(1, parts, 1, 0, (part % parts,)).pack()
        self.conversation.forge(Forgery(sender, 65, number, 0, 0, 1, "/p", body))

    @rule(sender=FORGER, kind=st.sampled_from(sorted(MSG_TYPES)), body=st.binary(max_size=40))
    def forge_any(self, sender: int, kind: int, body: bytes) -> None:
        self.conversation.forge(Forgery(sender, kind, 0, 0, 0, 1, "/p", body))

    def teardown(self) -> None:
        self.conversation.end()


Conversations.TestCase.settings = settings(
    max_examples=100,  # the same ones each time; fuzz.sequences draws others
    stateful_step_count=40,
    deadline=None,
    derandomize=True,
    phases=[Phase.generate],
)
TestConversations = Conversations.TestCase


def test_copy_of_a_repaired_message_is_no_restart() -> None:
    """A restarted sender with an older clock repairs its first message after 1 s of silence."""
    conversation = Conversation()
    conversation.send(HONEST, 0)
    conversation.transfer(HONEST, [0])
    conversation.wait(175)
    conversation.restart(HONEST, CLOCK_SHIFTS_NANOS.index(-NANOS))
    conversation.wait(652)
    conversation.send(HONEST, 500)
    lost = {1: LOST, 5: LOST, 19: ANSWER_LOST, 27: HELD, 29: LOST, 31: HELD, 33: LOST}
    conversation.transfer(HONEST, [lost.get(i, 0) for i in range(35)])
    conversation.transfer(HONEST, [0, TWICE, 0, 0, 0, 0])
    assert list(conversation.senders[HONEST].bodies.values()) == [1, 1]
