"""Model files: what they may hold, how errors read, round trip."""

import math

import pytest

from chatter_monitor.errors import InputError
from chatter_monitor.physics import cuts
from chatter_monitor.physics.model_file import model_text, read_model

EXAMPLE = """
[sensor]
quantity = "displacement"
[[mode]]
frequency_hz = 412.0
damping_ratio = 0.021
[excitation]
kind = "white_noise"
[spindle]
speed_rpm = 1800.0
teeth = 1
[[term]]
name = "cubic_stiffness"
coefficient = 0.05
"""


def read(tmp_path, text):
    file = tmp_path / "model.toml"
    file.write_text(text)
    return read_model(file)


def test_the_example_of_the_design_is_read(tmp_path):
    """The model file of the public contract gives the machining system that it describes."""
    system = read(tmp_path, EXAMPLE)
    assert [(mode.frequency_hz, mode.damping_ratio) for mode in system.modes] == [(412.0, 0.021)]
    assert system.sensor.quantity == "displacement"
    assert system.spindle.delay_s == pytest.approx(1.0 / 30.0)
    assert [(applied.term.name, applied.values) for applied in system.terms] == [("cubic_stiffness", (0.05,))]


def test_default_intensity_moves_the_mode_by_one_unit_rms(tmp_path):
    """Without an intensity S_0 = 2 zeta w^3 / pi, for which var(x) = pi S_0 / (2 zeta w^3) is one."""
    w = 2.0 * math.pi * 412.0
    assert math.pi * read(tmp_path, EXAMPLE).intensity / (2.0 * 0.021 * w**3) == pytest.approx(1.0)


@pytest.mark.parametrize("system", [cuts.stable_turning(), cuts.bar_turning(), cuts.forced_milling()])
def test_what_is_written_is_read_back_equal(tmp_path, system):
    """Writing a system and reading it gives the same system, drifts and all."""
    assert read(tmp_path, model_text(system)) == system


# what is replaced in the example, by what, and the words that the message has to hold
MISTAKES = [
    ("frequency_hz = 412.0", "frequency = 412.0", ["[[mode]] number 1", "unit of frequency", "Write frequency_hz."]),
    ("frequency_hz = 412.0", "frequenzy_hz = 412.0", ["unknown key frequenzy_hz", "Did you mean frequency_hz?"]),
    ("frequency_hz = 412.0", "frequency_hz = -412.0", ["[[mode]] number 1", "frequency_hz", "-412.0", "> 0"]),
    ("frequency_hz = 412.0", 'frequency_hz = "412"', ["frequency_hz", "'412'", "a number"]),
    ("frequency_hz = 412.0", "frequency_hz = true", ["frequency_hz", "True", "a number"]),
    ("frequency_hz = 412.0", "frequency_hz = nan", ["frequency_hz", "nan", "> 0"]),
    ("frequency_hz = 412.0", "", ["[[mode]] number 1", "frequency_hz is missing", "Add frequency_hz"]),
    (
        "damping_ratio = 0.021",
        "damping_ratio = -0.021",
        ["damping_ratio of mode 1", "-0.021", ">= 0", "energy_damping"],
    ),
    ("damping_ratio = 0.021", "damping_ratio = 1.5", ["damping_ratio", "1.5", "< 1"]),
    ('name = "cubic_stiffness"', 'name = "cubic_stifness"', ["[[term]] number 1", "Did you mean cubic_stiffness?"]),
    ('name = "cubic_stiffness"', "", ["[[term]] number 1", "name", "catalogue"]),
    ("coefficient = 0.05", "", ["cubic_stiffness", "lacks", "coefficient", "1/u^2"]),
    ("coefficient = 0.05", "coeficient = 0.05", ["unknown key coeficient", "Did you mean coefficient?"]),
    ("teeth = 1", "teeth = 1.5", ["[spindle]", "teeth", "1.5", "a whole number"]),
    ("teeth = 1", "teeth = 0", ["[spindle]", "teeth", "1 or more"]),
    ("[spindle]", "[spindel]", ["unknown key spindel", "Did you mean spindle?"]),
    ("[[mode]]", "[mode]", ["mode has to be a list", "Write [[mode]]."]),
    ('kind = "white_noise"', 'kind = "pink"', ["[excitation]", "pink", "white_noise, coloured"]),
    ('quantity = "displacement"', 'quantity = "force"', ["[sensor]", "force", "displacement, velocity"]),
    ('[sensor]\nquantity = "displacement"', "sensor = 3", ["[sensor]", "has to be a table"]),
    ("teeth = 1", "teeth = ", ["not valid TOML"]),
    (
        '[spindle]\nspeed_rpm = 1800.0\nteeth = 1\n[[term]]\nname = "cubic_stiffness"',
        '[[term]]\nname = "regenerative_delay"',
        ["regenerative_delay needs the spindle speed", "Add [spindle]"],
    ),
    (
        "coefficient = 0.05",
        'coefficient = 0.05\n[[drift]]\nparameter = "mode.2.frequency_hz"\ntime_s = [0, 1]\nvalue = [1, 2]',
        ["mode.2.frequency_hz", "mode.1.frequency_hz", "term.1.coefficient"],
    ),
    (
        "coefficient = 0.05",
        'coefficient = 0.05\n[[drift]]\nparameter = "mode.1.damping_ratio"\ntime_s = [0, 1]\nvalue = [0.1, -0.2]',
        ["damping_ratio of mode 1", "-0.2"],
    ),
    (
        "coefficient = 0.05",
        'coefficient = 0.05\n[[drift]]\nparameter = "mode.1.frequency_hz"\ntime_s = [1, 0]\nvalue = [1, 2]',
        ["[[drift]] number 1", "time_s", "has to increase"],
    ),
]


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES)
def test_a_mistake_is_named_with_file_key_and_remedy(tmp_path, old, new, words):
    """Every mistake in a model file is answered with the file, the key, what is allowed and what to do."""
    assert old in EXAMPLE
    with pytest.raises(InputError) as caught:
        read(tmp_path, EXAMPLE.replace(old, new))
    assert all(word in str(caught.value) for word in ["model.toml", *words]), str(caught.value)


def test_negative_damping_is_allowed_where_something_limits_it(tmp_path):
    """A self-excited mode with amplitude-dependent damping is a valid model."""
    text = EXAMPLE.replace("0.021", "-0.01").replace("cubic_stiffness", "energy_damping")
    assert read(tmp_path, text).modes[0].damping_ratio == -0.01


def test_a_file_that_is_not_there_is_named(tmp_path):
    """A missing file is the user's input error, with its name."""
    with pytest.raises(InputError, match=r"absent\.toml"):
        read_model(tmp_path / "absent.toml")
