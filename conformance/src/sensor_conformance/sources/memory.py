# SPDX-License-Identifier: Apache-2.0
"""Messages that are in memory already."""

from collections.abc import Iterator, Mapping, Sequence

from .source import Received, SourceTopic


class MemorySource:
    """A source of given messages, for tests and for programs that make messages.

    Parameters
    ----------
    messages
        For each topic its messages, in the order of their arrival.
    """

    def __init__(
        self, messages: Mapping[SourceTopic, Sequence[Received]], name: str = "memory"
    ) -> None:
        self.name = name
        self._topics = tuple(messages)
        self._messages = {topic.name: list(all_of) for topic, all_of in messages.items()}

    def topics(self) -> Sequence[SourceTopic]:
        """Return all topics."""
        return self._topics

    def messages(self, topic: str) -> Iterator[Received]:
        """Yield the messages of a topic in the order of their arrival."""
        yield from self._messages[topic]
