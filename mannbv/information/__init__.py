"""What a view tells about the splats: Fisher information, its prior, and the gain, Eqs. (3)-(5), (14), (15).

Parameters per splat, in the world frame: mean (d), log-scale (d), rotation in the body's tangent space (d(d−1)/2),
opacity logit (1), colour (3): 9 in flatland, 13 in 3-D.
"""

from mannbv.information.fisher import blocks, fisher, n_parameters, prior
from mannbv.information.gain import damping, gain, gain_and_gradient, gain_and_slope, mean_variances, view_gain
from mannbv.information.profile import YawProfile, uniform_yaws, yaw_profile
from mannbv.information.views import FREEDOMS, View, best_view, directions, slopes

__all__ = [
    "FREEDOMS",
    "View",
    "YawProfile",
    "best_view",
    "blocks",
    "damping",
    "directions",
    "fisher",
    "gain",
    "gain_and_gradient",
    "gain_and_slope",
    "mean_variances",
    "n_parameters",
    "prior",
    "slopes",
    "uniform_yaws",
    "view_gain",
    "yaw_profile",
]
