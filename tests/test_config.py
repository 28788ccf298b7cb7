import dataclasses
import inspect
import json
import math

import numpy as np
import pytest

from mannbv import config as room
from mannbv.config import Config


def test_every_constant_has_a_unit_a_meaning_and_a_source():
    for field in dataclasses.fields(Config):
        assert set(field.metadata) == {"unit", "meaning", "source"}
        assert field.metadata["meaning"]
        assert field.metadata["source"]
        assert field.metadata["unit"] or isinstance(field.default, str)
    table = room.describe(Config().replace(level=0.25)).splitlines()
    assert len(table) == len(dataclasses.fields(Config))
    line = next(row for row in table if row.startswith("level "))
    assert "0.25" in line


def test_a_config_is_frozen_and_varied_by_replace():
    config = Config()
    assert config.replace(level=0.05).level == 0.05
    assert config.level == 0.1
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.level = 0.2


def test_json_keeps_everything():
    config = Config().replace(level=0.05, n_yaws=72, measure="var", fov=math.radians(70))
    assert Config.from_json(config.to_json()) == config
    assert Config.from_json("{}") == Config()
    assert set(json.loads(config.to_json())) == {f.name for f in dataclasses.fields(Config)}


def test_numbers_of_numpy_are_numbers(unchecked):
    assert Config().replace(level=np.float32(0.25), n_yaws=np.int64(8), stride=1).n_yaws == 8
    config = Config().replace(level=np.float32(0.25), n_yaws=np.int64(8))
    assert Config.from_json(config.to_json()) == config


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("level", 0.0, "level must lie strictly between 0 and 1"),
        ("level", 1.0, "level must lie strictly between 0 and 1"),
        ("level", math.nan, "level must be a finite number"),
        ("level", "low", "level must be a finite number"),
        ("stride", 0.0, "stride must be positive"),
        ("sigma_color", 0.0, "sigma_color must be positive"),
        ("sigma_depth", -1.0, "sigma_depth must not be negative"),
        ("max_depth", math.inf, "max_depth must be a finite number"),
        ("fov", math.pi, "fov must be below π"),
        ("fov", 0.0, "fov must be positive"),
        ("image_width", 0, "image_width must be positive"),
        ("image_width", 2.5, "image_width must be a whole number"),
        ("n_yaws", 3, "n_yaws must be at least 4"),
        ("n_subgoals", 0, "n_subgoals must be positive"),
        ("rounds", -1, "rounds must not be negative"),
        ("rounds", True, "rounds must be a whole number"),
        ("margin", -0.1, "margin must not be negative"),
        ("measure", 3, "measure must be a name"),
        ("measure", None, "measure must be a name"),
        ("prior", "posterior", "prior must be recompute or incremental, got posterior$"),
        ("moments", "eternal", "moments must be fresh or kept, got eternal$"),
        ("risk_from", "bodies", r"risk_from must be body or camera, got bodies; did you mean body\?$"),
        ("weighs", "boht", r"weighs must be acquired or both, got boht; did you mean both\?$"),
        ("damped", "every view", "damped must be prior or views, got every view"),
        ("spread", "widest", "spread must be largest or along, got widest"),
        ("answers", "gradients", r"answers must be gain or gradient, got gradients; did you mean gradient\?$"),
        ("adam_beta2", 1.0, "adam_beta2 must be below 1"),
        ("evidence_pass", -0.4, "evidence_pass must not be negative"),
    ],
)
def test_impossible_constants_are_named(name, value, message, unchecked):
    with pytest.raises(ValueError, match=f"^config: {message}"):
        Config().replace(**{name: value})


def test_unknown_constants_are_named():
    with pytest.raises(ValueError, match="no constant is called alpha, vim; see"):
        Config().replace(vim=1.0, alpha=2.0)
    for wrong in (lambda: Config(penality=1.0), lambda: Config().replace(penality=1.0)):
        with pytest.raises(ValueError, match=r"^config: no constant is called penality; did you mean penalty\?$"):
            wrong()
    assert "penalty" in inspect.signature(Config).parameters
    for text in ("[1, 2]", "{"):
        with pytest.raises(ValueError, match=r"^config: "):
            Config.from_json(text)
