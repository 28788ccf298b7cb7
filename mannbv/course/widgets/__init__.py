"""Explorers: pictures that a hand moves, in JupyterLab and under Voilà."""

from mannbv.course.widgets.bound import lower_bound
from mannbv.course.widgets.camera import splat_and_camera
from mannbv.course.widgets.consensus import agreement
from mannbv.course.widgets.explorer import Explorer
from mannbv.course.widgets.information import information_over_yaw
from mannbv.course.widgets.masks import masks_along_a_path
from mannbv.course.widgets.messages import messages
from mannbv.course.widgets.paths import risk_weight
from mannbv.course.widgets.player import player
from mannbv.course.widgets.replay import replay
from mannbv.course.widgets.risk import risk_field
from mannbv.course.widgets.walk import walk

__all__ = [
    "Explorer",
    "agreement",
    "information_over_yaw",
    "lower_bound",
    "masks_along_a_path",
    "messages",
    "player",
    "replay",
    "risk_field",
    "risk_weight",
    "splat_and_camera",
    "walk",
]
