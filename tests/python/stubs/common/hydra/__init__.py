"""`compose` of one file: an override has to be of a key that is there, `+experiment=NAME` of a file that is there."""

import contextlib
import json
import pathlib

from omegaconf import OmegaConf

_folder = None


@contextlib.contextmanager
def initialize_config_dir(config_dir, version_base=""):
    global _folder
    assert pathlib.Path(config_dir).is_absolute(), "Hydra takes no relative folder"
    _folder = pathlib.Path(config_dir)
    yield
    _folder = None


def compose(config_name, overrides=()):
    config = OmegaConf.load(_folder / f"{config_name}.yaml")
    for override in overrides:
        key, value = override.split("=", 1)
        if key.startswith("+"):
            assert (_folder / key[1:] / f"{value}.yaml").is_file(), override
            continue
        *path, last = key.split(".")
        node = config
        for name in path:
            node = node[name]
        assert last in node, f"{override}: Hydra wants a + before keys that are not there"
        try:
            node[last] = json.loads(value)
        except json.JSONDecodeError:
            node[last] = value
    return config
