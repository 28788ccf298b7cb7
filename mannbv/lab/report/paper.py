"""What the paper prints in its six tables."""

BUILDINGS = ("Denmark", "Cantwell", "Ribera", "Swormville")

# Table I, a building each
MAP_SCORES = ("total_risk_m", "psnr_db", "depth_mae_m")
MAPS = {
    "centralized": ((0.85, 19.57, 0.15), (0.29, 17.68, 0.25), (0.82, 18.13, 0.28), (0.63, 20.55, 0.15)),
    "distributed": ((0.72, 18.85, 0.18), (0.22, 16.98, 0.29), (0.75, 17.09, 0.36), (0.61, 20.20, 0.15)),
    "limited": ((0.80, 19.21, 0.16), (0.28, 17.61, 0.26), (0.76, 17.39, 0.35), (0.61, 20.53, 0.15)),
    "single": ((0.67, 16.75, 0.31), (0.18, 15.41, 0.35), (0.57, 14.65, 0.42), (0.57, 16.45, 0.41)),
}
# Table II, "communication size per robot", of one exchange: sent, received [KB]
EXCHANGE = {"distributed": ("0.206", "0.028"), "limited": ("25", "25")}
# Tables III and V, a planning step each: splats of every robot, "shared data size" [MB, really MiB]
GROWTH = {
    2: (
        ((34_911, 26_800), 3.26),
        ((62_634, 60_898), 6.59),
        ((161_396, 148_005), 16.50),
        ((190_716, 189_123), 20.28),
    ),
    5: (
        ((56_741, 51_055, 30_174, 50_368, 22_909), 11.19),
        ((64_612, 55_718, 34_548, 61_713, 37_310), 13.55),
    ),
}
# Table IV, a building each
PATH_SCORES = ("path_overhead", "risk_gain_share")
PATHS = {
    "centralized": ((27.9, 43.1), (27.6, 13.3), (11.7, 20.7), (24.7, 38.1)),
    "distributed": ((29.5, 37.8), (31.6, 12.5), (14.3, 19.7), (28.8, 37.0)),
    "limited": ((28.2, 41.5), (29.8, 13.3), (12.1, 20.1), (25.3, 37.5)),
    "single": ((31.1, 36.8), (36.2, 11.7), (15.7, 17.2), (30.9, 35.5)),
}
# Table VI, by team size: centralized [MB, really MiB], limited [MB]
TEAMS = {2: (3.63, 0.050), 5: (8.95, 0.50), 7: (10.39, 1.050), 10: (16.84, 2.150)}
