"""A fingerprint of what a campaign says of its sensors and runs, by which a result knows what it was made from.

It is the same for a copy in another folder, and after a session that recorded nothing.
"""

from __future__ import annotations

import dataclasses
from hashlib import sha256
from typing import Any

import numpy as np

from shockrig.files.campaign import Campaign

NOT_OF_IT = {"path", "sessions", "misspelt", "planned", "set_aside", "extra", "pressure_known"}  # of it and its runs


def fingerprint(campaign: Campaign) -> str:
    """Of a campaign as one probe saw it: 64 hexadecimal digits."""
    digest = sha256()
    _add(digest, campaign)
    return digest.hexdigest()


def _add(digest: Any, value: Any) -> None:
    """Add a value with its kind and length, so that no two differ in nothing but where one ends."""
    if dataclasses.is_dataclass(value):
        # Python's class of campaigns adds notes of its own.
        stated = dataclasses.fields(Campaign if isinstance(value, Campaign) else value)
        _add(digest, {f.name: getattr(value, f.name) for f in stated if f.name not in NOT_OF_IT})
    elif isinstance(value, np.ndarray):
        digest.update(f"array {value.dtype} {value.shape}\n".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, dict):
        digest.update(f"object {len(value)}\n".encode())
        for key in sorted(value):
            _add(digest, key)
            _add(digest, value[key])
    elif isinstance(value, tuple | list):
        digest.update(f"list {len(value)}\n".encode())
        for item in value:
            _add(digest, item)
    else:
        text = repr(value)
        digest.update(f"value {len(text)} {text}\n".encode("utf-8", "surrogatepass"))
