# SPDX-License-Identifier: Apache-2.0
import io

import pytest
from msgspec.structs import replace
from rich.console import Console
from rich.text import Text

from groundlink.cli.run.dashboard import dashboard, missions_table
from groundlink.cli.run.supervised import LINES_SHOWN, SupervisedRun, failures, say_faults
from groundlink.cli.terminal.output import PLAIN_WIDTH
from groundlink.episode.mission import Mission, MissionEvent
from groundlink.messages.base import Health, StreamReport
from groundlink.messages.stalls import Stalls
from groundlink.monitor.run_monitor import RunMonitor
from groundlink.monitor.supervisor import Child

HEALTHY = StreamReport(
    "/wheel_encoders",
    "WheelEncoders",
    50.0,
    50.0,
    0.0123,
    499_998,
    0,
    age_p99_seconds=0.1234,
    sent=499_999,
    in_flight=1,
)
LOSSY = StreamReport(
    "/camera/compressed",
    "CompressedImage",
    30.0,
    29.97,
    0.0123,
    299_980,
    18,
    age_p99_seconds=1.2345,
    sent=300_000,
    missing=11,
    incomplete=7,
    dropped=2,
    repaired=12_345,
    superseded=3,
)
BACK = StreamReport("/cmd_vel", "Twist", None, 20.0, 0.001, 7, 0, direction="from ROS", sent=7)


def shown(*healths: Health, width: int = PLAIN_WIDTH) -> str:
    """Return the tables after these messages; sensors are children of the command."""
    monitor = RunMonitor()
    for health in healths:
        monitor.update(health, 0.0)
    children = [Child(health.process, []) for health in healths if "/" in health.process]
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        console.print(dashboard("lab", monitor, children))
    return capture.get()


def drawn(*streams: StreamReport, width: int = PLAIN_WIDTH) -> str:
    return shown(Health("gateway", 1, 400, {}, streams), width=width)


def test_stalled_process_is_shown_on_top() -> None:
    told = Stalls(("rover/lidar",), {"rover/lidar": 6.0}, {"rover/lidar": 5.0})
    picture = shown(Health("physics", 1, 400, {"worlds": 0} | told.counters()))
    second = picture.splitlines()[1]
    assert second.strip() == "silent: rover/lidar; time stretched by 5.0 s (rover/lidar 5.0 s)"


def line(picture: str, topic: str) -> str:
    return next(text for text in picture.splitlines() if topic in text)


def test_every_figure_stands_in_the_table_uncut() -> None:
    picture = drawn(HEALTHY, LOSSY, BACK)
    assert "…" not in picture
    healthy = line(picture, "/wheel_encoders")
    for figure in ("50 Hz", "50.00 Hz", "12.3 ms", "123.4 ms", "499999", "499998"):
        assert figure in healthy
    assert "(back)" in line(picture, "/cmd_vel")
    assert max(map(len, picture.splitlines())) <= PLAIN_WIDTH


@pytest.mark.parametrize("width", [110, 80, 60, 40])
def test_a_narrow_terminal_costs_no_number(width: int) -> None:
    long = replace(LOSSY, topic="/front_left/camera/image_raw/compressed")
    for streams in ((HEALTHY, LOSSY, BACK), (long,)):
        picture = drawn(*streams, width=width)
        assert "…" not in picture
        assert max(map(len, picture.splitlines())) <= width
        cells = {cell.strip() for text in picture.splitlines() for cell in text.split("│")}
        for stream in streams:
            for number in (stream.sent, stream.messages, stream.repaired):
                assert str(number) in cells
        assert {"29.97 Hz", "1234.5 ms"} <= cells
        words = " ".join(cells).replace(",", "").split()
        assert {"11", "7", "2", "3", "missing", "superseded"} <= set(words)


def test_narrow_terminal_drops_types_then_constant_columns() -> None:
    def head(width: int) -> str:
        return line(drawn(HEALTHY, width=width), "topic")

    assert "type" in head(100)
    assert "type" not in head(85)
    assert "declared" in head(85)
    assert "declared" not in head(76)
    assert "lost" in head(76)


def test_the_processes_fit_a_narrow_terminal() -> None:
    counters = {"readings": 123_456, "gap_overloaded": 12, "missed_ticks": 34, "refused": 56}
    for width in (80, 60):
        picture = shown(Health("rover/front_camera", 4321, 400, counters), width=width)
        assert "…" not in picture
        assert all(word in picture for word in ("123456", "12", "34", "56", "rover/front_camera"))
        assert max(map(len, picture.splitlines())) <= width


def test_lines_of_processes_stand_below_the_picture_of_a_terminal() -> None:
    console = Console(width=80, file=io.StringIO(), force_terminal=True)
    run = SupervisedRun({"gateway": []}, "run", "tcp/127.0.0.1:0", console)
    for number in range(LINES_SHOWN + 8):
        run.log(f"line {number}")
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue() == ""
    with console.capture() as capture:
        console.print(run._with_lines("picture"))
    picture = capture.get().split("\n")
    assert [text.strip() for text in picture if text.strip()] == [
        "picture",
        *(f"line {number}" for number in range(8, LINES_SHOWN + 8)),
    ]


def test_a_low_terminal_shows_the_newest_lines_and_what_fits_above() -> None:
    console = Console(width=80, height=10, file=io.StringIO(), force_terminal=True)
    run = SupervisedRun({"gateway": []}, "run", "tcp/127.0.0.1:0", console)
    for number in range(8):
        run.log(f"line {number}")
    for rows, above in ((5, range(5)), (30, range(4))):
        picture = Text("\n".join(f"row {row}" for row in range(rows)))
        with console.capture() as capture:
            console.print(run._with_lines(picture), end="")
        shown = [text.strip() for text in capture.get().splitlines()]
        assert shown[-LINES_SHOWN:] == [f"line {number}" for number in range(3, 8)]
        cut = ["..."] if rows > len(above) else []
        assert shown[:-LINES_SHOWN] == [*(f"row {row}" for row in above), *cut]


def test_losses_are_shown_by_cause() -> None:
    lost = [text.split("│")[-2] for text in drawn(LOSSY).splitlines() if text.startswith("│")]
    assert " ".join(" ".join(lost).split()) == ("11 missing, 7 incomplete, 2 dropped, 3 superseded")


def test_unreported_messages_are_shown_and_not_lost() -> None:
    unknown = replace(LOSSY, messages=0, lost=0, missing=0, reported=False)
    (row,) = (line for line in drawn(unknown).splitlines() if unknown.topic in line)
    assert "not reported" in row
    assert "missing" not in row


def test_failed_sensor_is_shown() -> None:
    failing = {"readings": 7, "fault_stuck": 1, "fault_bias": 1}
    picture = shown(
        Health("rover/imu", 1, 400, failing), Health("rover/lidar", 1, 400, {"readings": 9})
    )
    assert "rover/imu: stuck, bias" in line(picture, "rover/imu")
    assert ":" not in line(picture, "rover/lidar")


def test_missing_readings_are_shown_with_cause() -> None:
    counters = {"readings": 7, "gap_overloaded": 12, "gap_not there": 3}
    picture = shown(Health("rover/camera", 1, 400, counters))
    cells = [cell.strip() for cell in line(picture, "rover/camera").split("│")]
    assert cells[4:6] == ["12 overloaded, 3 not there", "readings 7"]


STUCK = MissionEvent("stuck", 3.0, None, (1.5, 0.0, 0.2), (0.5, 0.0), ("table_1",))
MISSION = Mission("rover", "stuck", 20.0, 0.625, 1.5, 10.0, 1.5, 0.2, 0.0, 17.0, (), STUCK, "pull")
FINE = Mission("second_rover", "standing", 20.0, None, 4.0, 4.1, 4.0, 1.0, 0.99, 0.0, ())


@pytest.mark.parametrize("width", [80, 110])
def test_missions_fit_a_narrow_terminal(width: int) -> None:
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        console.print(missions_table([MISSION, FINE]))
    picture = capture.get()
    assert max(map(len, picture.splitlines())) <= width
    cells = [cell.strip() for cell in line(picture, "rover").split("│")[1:-1]]
    assert cells == ["rover", "stuck", "62 %", "1.5 m", "15 %", "-", "17.0 s"]
    assert "standing" in line(picture, "second_rover")


def test_a_bad_end_fails_only_runs_with_a_goal() -> None:
    failure = MISSION.failure()
    assert failures([MISSION, FINE], ["rover", "second_rover"]) == [failure]
    assert failures([MISSION, FINE], []) == []


def test_faults_are_printed_once_and_the_rest_as_warnings() -> None:
    console = Console(width=80, file=io.StringIO())
    with console.capture() as capture:
        say_faults(console, [f"{MISSION.failure()}"], [MISSION, FINE])
    assert capture.get().splitlines() == [
        "failed: rover: stuck at x 1.50, y 0.00 m since 3.0 s (commanded 0.50 m/s, 0.00 rad/s), "
        "touching `table_1`. Fix: pull",
        "warning: rover drove 1.5 of 10.0 m commanded",
    ]


def test_all_figures_of_streams_stand_in_one_table_of_80_columns() -> None:
    topics = ("/camera/image_raw/compressed", "/camera/camera_info", "/ground_truth/odom")
    lossy = replace(HEALTHY, lost=3, superseded=3)
    picture = drawn(*(replace(lossy, topic=topic) for topic in topics), width=80)
    streams, _ = picture.split("processes")
    heads = [text for text in streams.splitlines() if text.startswith("┃")]
    assert len(heads) == 1
    assert {"measured", "arrived", "repaired", "lost"} <= {
        cell.strip() for cell in heads[0].split("┃")
    }
    assert "│/camera/image_raw│" in streams
    assert "│/compressed      │" in streams
