# SPDX-License-Identifier: Apache-2.0
"""Labels of pictures and clouds: segmentation images, boxes in pictures and in space.

Made by models of cameras and LiDARs whose scenario asks for labels. Knows no bus.
"""
