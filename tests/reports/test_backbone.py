"""What the report draws of recording and simulations."""

import numpy as np
import pytest

from chatter_monitor.reports.diagnosis.runs import backbone


@pytest.mark.parametrize("hz_per_amplitude", [0.0, 4.0, -4.0])
def test_the_backbone_tells_how_the_frequency_goes_with_the_amplitude(hz_per_amplitude):
    """A vibration whose frequency rises by 4 Hz a unit of amplitude is shown to rise so, a level one level."""
    rate_hz = 12_800.0
    t = np.arange(1 << 17) / rate_hz
    amplitude = 1.0 + 0.8 * np.sin(2.0 * np.pi * 0.7 * t)
    phase = 2.0 * np.pi * np.cumsum(300.0 + hz_per_amplitude * amplitude) / rate_hz
    over_rms, hertz = backbone(amplitude * np.cos(phase), rate_hz, 300.0)
    rms = np.sqrt(0.5 * np.mean(amplitude**2))
    assert hertz == pytest.approx(300.0 + hz_per_amplitude * rms * over_rms, abs=0.3)
