# SPDX-License-Identifier: Apache-2.0
"""Faults in packets of LiDARs."""

import zlib
from typing import Any

import numpy as np

from sensor_conformance.sources.source import Received

from .clean_packets import checked
from .fault import each, fault


@each("the mark of a block is missing", "velodyne.structure", "/velodyne")
def _(message: Any) -> None:
    message.data[300:302] = 0


@fault("a packet is cut off", "velodyne.structure", "/velodyne")
def _(messages: list[Received]) -> None:
    messages[9].message.data = messages[9].message.data[:1200]


@each("the factory bytes are zero", "velodyne.factory", "/velodyne")
def _(message: Any) -> None:
    message.data[1204:] = 0


@fault("azimuths stand still", "velodyne.azimuth", "/velodyne")
def _(messages: list[Received]) -> None:
    for _, message in messages:
        message.data[:1200] = messages[0].message.data[:1200]


def _retime(messages: list[Received], factor: float) -> None:
    for _, message in messages:
        time = message.data[1200:1204].view("<u4") * factor
        message.data[1200:1204] = time.astype("<u4").view(np.uint8)


@fault("times are in units of 100 us", "velodyne.timestamp", "/velodyne")
def _(messages: list[Received]) -> None:
    _retime(messages, 0.01)


@fault("the clock of the head is fast by 10 %", "velodyne.timestamp", "/velodyne")
def _(messages: list[Received]) -> None:
    _retime(messages, 1.1)


@each("packets have one column more", "ouster.structure", "/ouster")
def _(message: Any) -> None:
    message.data = np.concatenate((message.data, message.data[:213]))


@fault("columns do not count up", "ouster.columns", "/ouster")
def _(messages: list[Received]) -> None:
    for _, message in messages:
        columns = message.data.reshape(16, -1)
        columns[:, 8:10] = columns[::-1, 8:10].copy()


@fault("all columns of a packet have one time", "ouster.timestamp", "/ouster")
def _(messages: list[Received]) -> None:
    for _, message in messages:
        columns = message.data.reshape(16, -1)
        columns[:, :8] = columns[0, :8]


@each("columns are marked as invalid", "ouster.valid", "/ouster")
def _(message: Any) -> None:
    message.data.reshape(16, -1)[:, -4:] = 0


@each("acceleration of packets is in m/s2", "ouster.imu", "/ouster_imu")
def _(message: Any) -> None:
    message.data[24:36] = (message.data[24:36].view("<f4") * np.float32(9.81)).view(np.uint8)


@fault("a packet has 30 lasers", "hesai.structure", "/hesai")
def _(messages: list[Received]) -> None:
    messages[9].message.data[6] = 30


@fault("a packet of Hesai is cut off", "hesai.structure", "/hesai")
def _(messages: list[Received]) -> None:
    messages[9].message.data = messages[9].message.data[:1000]


@fault("every twentieth packet of Hesai is lost", "hesai.sequence", "/hesai")
def _(messages: list[Received]) -> list[Received]:
    return [one for index, one in enumerate(messages) if index % 20]


@fault("two packets are exchanged", "hesai.sequence", "/hesai")
def _(messages: list[Received]) -> None:
    messages[9], messages[10] = messages[10], messages[9]


@each("all blocks of a packet have one azimuth", "hesai.azimuth", "/hesai")
def _(message: Any) -> None:
    blocks = message.data[12:1052].reshape(8, 130)
    blocks[:, :2] = blocks[0, :2]


@each("azimuths are in thousandths of a degree, modulo 65536", "hesai.azimuth", "/hesai")
def _(message: Any) -> None:
    blocks = message.data[12:1052].reshape(8, 130)
    azimuths = np.ascontiguousarray(blocks[:, :2]).view("<u2")
    blocks[:, :2] = (azimuths * 10).astype("<u2").view(np.uint8)


@each("microseconds are nanoseconds", "hesai.timestamp", "/hesai")
def _(message: Any) -> None:
    micros = message.data[1071:1075].view("<u4")
    micros[:] = micros * np.uint32(1000)


@each("the date does not change", "hesai.timestamp", "/hesai")
def _(message: Any) -> None:
    message.data[1065:1071] = 123, 11, 14, 22, 59, 58


@each("the month counts from 0", "hesai.timestamp", "/hesai")
def _(message: Any) -> None:
    message.data[1066] = 0


@each("the return mode is unknown", "hesai.return_mode", "/hesai")
def _(message: Any) -> None:
    message.data[1062] = 0


@each("two returns, but the mode of one", "hesai.return_mode", "/hesai")
def _(message: Any) -> None:
    message.data[1062] = 0x37


@each("the speed is in degrees/s", "hesai.motor", "/hesai")
def _(message: Any) -> None:
    message.data[1063:1065].view("<u2")[0] = 2400


@each("the number of points is that of a line", "livox.structure", "/livox")
def _(message: Any) -> None:
    message.data[5] = 24


@each("the type of time is unknown", "livox.structure", "/livox")
def _(message: Any) -> None:
    message.data[11] = 9


@fault("a bit of a packet flips", "livox.checksum", "/livox")
def _(messages: list[Received]) -> None:
    messages[9].message.data[700] ^= 1


@each("the checksum is that of the whole packet", "livox.checksum", "/livox")
def _(message: Any) -> None:
    message.data[24:28] = 0
    message.data[24:28].view("<u4")[0] = zlib.crc32(message.data.tobytes())


@fault("every twentieth packet of Livox is lost", "livox.counter", "/livox")
def _(messages: list[Received]) -> list[Received]:
    return [one for index, one in enumerate(messages) if index % 20 != 5]


@each("packets are not counted", "livox.counter", "/livox")
def _(message: Any) -> None:
    message.data[7:9] = 0


def _restamp(messages: list[Received], factor: float) -> None:
    first = int(messages[0].message.data[28:36].view("<u8")[0])
    for _, message in messages:
        time = message.data[28:36].view("<u8")
        time[0] = first + round((int(time[0]) - first) * factor)
        checked(message.data)


@fault("times of Livox are microseconds", "livox.timestamp", "/livox")
def _(messages: list[Received]) -> None:
    _restamp(messages, 1e-3)


@fault("the clock of Livox is fast by 8 %", "livox.timestamp", "/livox")
def _(messages: list[Received]) -> None:
    _restamp(messages, 1.08)


@each("coordinates are meters as float32", "livox.points", "/livox")
def _(message: Any) -> None:
    spots = message.data[36:].reshape(-1, 14)
    places = np.ascontiguousarray(spots[:, :12]).view("<i4")
    spots[:, :12] = (places / 1000).astype("<f4").view(np.uint8)
    checked(message.data)


@each("no point has a return", "livox.points", "/livox")
def _(message: Any) -> None:
    message.data[36:] = 0
    checked(message.data)
