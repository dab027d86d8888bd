# SPDX-License-Identifier: Apache-2.0
"""What of a recording goes on the bus again.

Rule: the streams that physics and sensors once published, and the commands. What the vehicle's
stack told of itself is left out: the stack that is tested tells it anew.
"""

from __future__ import annotations

from groundlink.recording.playback import Playback
from groundlink.recording.reader import Recording
from groundlink.ros.streams import incoming, outgoing, recorded_only


class Player(Playback):
    """The playback of a replay.

    Parameters
    ----------
    run
        name under which the run is on the bus.
    """

    def __init__(self, recording: Recording, run: str) -> None:
        scenario = recording.run.scenario
        commands = [stream for stream in incoming(scenario, run) if stream.is_command]
        streams = (*commands, *outgoing(scenario, run), *recorded_only(scenario, run))
        super().__init__(recording, streams)
