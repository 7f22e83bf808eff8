"""Configurations in JSON, which is YAML too."""

import json
import pathlib


class Config(dict):
    __getattr__ = dict.__getitem__
    __setattr__ = dict.__setitem__


class OmegaConf:
    @staticmethod
    def load(path):
        return json.loads(pathlib.Path(path).read_text(), object_hook=Config)

    @staticmethod
    def to_container(config, resolve=False):
        return json.loads(json.dumps(config))
