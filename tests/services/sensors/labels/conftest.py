# SPDX-License-Identifier: Apache-2.0
from tests.services.sensors.rendering.opengl import _opengl as _opengl
