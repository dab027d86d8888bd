# SPDX-License-Identifier: Apache-2.0
"""Base class of the files that an export writes from a topic."""

import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

from .dataset import Dataset


class UnsuitableMessages(Exception):
    """The messages of a topic do not fit a format."""


class TopicExport(ABC):
    """Files of one format from the messages of one topic."""

    format: ClassVar[str]
    ending: ClassVar[str]
    """Of the path, after the name of the topic; a folder ends in `/`."""

    def __init__(self, dataset: Dataset, topic: str, stem: Path) -> None:
        self.topic = topic
        self.path = Path(f"{stem}{self.ending}")
        self.messages = 0
        self.unsuitable = ""
        """Why the messages do not fit; empty if they do."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Topics whose messages `add` takes."""
        return (self.topic,)

    @staticmethod
    @abstractmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        """Return whether the messages of a topic may fit."""

    @abstractmethod
    def add(self, time_nanos: int, message: Any) -> None:
        """Write a message, or collect it. Raises UnsuitableMessages if it does not fit."""

    @abstractmethod
    def close(self) -> None:
        """Write what was collected. Raises UnsuitableMessages if it does not fit."""

    @contextmanager
    def fitting(self) -> Iterator[None]:
        """Delete what was written if the messages turn out not to fit."""
        try:
            yield
        except UnsuitableMessages as error:
            self.unsuitable = str(error)
            self.messages = 0
            if self.path.is_dir():
                shutil.rmtree(self.path)
            else:
                self.path.unlink(missing_ok=True)
