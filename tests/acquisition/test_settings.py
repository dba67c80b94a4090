"""Settings of the input."""

from __future__ import annotations

import msgspec
import pytest

from chatter_monitor.acquisition.settings import InputSettings


def test_an_empty_table_listens_to_everything_as_it_is():
    """Without any key all channels are heard and no sample is scaled."""
    settings = msgspec.convert({}, InputSettings)
    assert settings.channels is None
    assert settings.full_scale_per_unit == 1.0


@pytest.mark.parametrize(
    "table",
    [
        {"channels": []},
        {"channels": [-1]},
        {"channels": [0, 0]},
        {"channels": [0.5]},
        {"full_scale_per_unit": 0.0},
        {"full_scale_per_unit": float("inf")},
        {"full_scale_per_unit": float("nan")},
        {"full_scale_per_unit": "loud"},
        {"sensor": "ear"},
        {"chanels": [0]},
    ],
)
def test_nonsense_is_refused(table):
    """Unknown keys and values outside their range do not pass."""
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(table, InputSettings)
