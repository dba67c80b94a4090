"""The proof: key, score, resumption, page."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

from chatter_monitor.discrepancy.prove.blind import laws
from chatter_monitor.discrepancy.prove.blind.machine import Machine, move, with_strength
from chatter_monitor.discrepancy.prove.blind.motion import Hidden
from chatter_monitor.discrepancy.prove.key import open_key, seal
from chatter_monitor.discrepancy.prove.scoring import count, information_nats, judge, overlap, strength_bin
from chatter_monitor.discrepancy.report import Estimate, Finding, Located, Statistic
from chatter_monitor.errors import InputError
from chatter_monitor.reports.proof import lines, proof_page
from chatter_monitor.service.proving import Proving
from tests.proving_engine import fails, report, says_nothing


def truth(kind="cubic hardening", family="catalogue", verdict="missing_physics", names=("cubic_stiffness",), **rest):
    return {
        "kind": kind,
        "family": family,
        "verdict": verdict,
        "names": list(names),
        "sense": None,
        "parameters": {},
        "strength": 0.03,
        "seconds": 20.0,
        "quantity": "velocity",
        "concealed": True,
        "concealment": {"distance": 0.031, "band95": 0.035, "normality_p": 0.4},
        "frequency_hz": 400.0,
        "damping_ratio": 0.02,
        "rms_displacement": 1.0,
        "time_s": [],
        **rest,
    }


NOTHING = truth("nothing", "linear", "none", ())
OUTSIDE = truth("stiffness notch", "outside", "unknown", ())


def finding(name, **parameters):
    estimates = {key: Estimate(value, (value - 0.1, value + 0.1), "1") for key, value in parameters.items()}
    return Finding(name, None, estimates, 20.0, 1e-4, "")


def named(*names):
    return report("missing_physics", [finding(name) for name in names], gain_nats=20.0)


@pytest.mark.parametrize(
    ("hidden", "answer", "outcome"),
    [
        (truth(), named("cubic_stiffness"), "right"),
        (truth(), named("clearance"), "wrong"),
        (truth(), named("cubic_stiffness", "clearance"), "wrong"),
        (truth(), report("unknown"), "abstained"),
        (truth(), report("none"), "missed"),
        (truth(), report("parameters"), "missed"),
        (NOTHING, report("none"), "right"),
        (NOTHING, report("parameters"), "wrong"),
        (NOTHING, named("clearance"), "wrong"),
        (NOTHING, report("unknown"), "wrong"),
        (OUTSIDE, report("unknown"), "right"),
        (OUTSIDE, named("clearance"), "wrong"),
        (OUTSIDE, report("none"), "missed"),
        (OUTSIDE, None, "failed"),
    ],
)
def test_outcomes(hidden, answer, outcome):
    """An answer is right only if it is exactly what was hidden; `unknown` and silence are told from a wrong name."""
    assert judge("0001", hidden, answer).outcome == outcome


def test_parameters_and_sense_of_a_right_name():
    """Where the right name leads, its sense and intervals are compared with the truth; elsewhere they mean nothing."""
    hidden = truth(sense="hardening", parameters={"coefficient": 1.0})
    hit = judge("1", hidden, report("missing_physics", [finding("cubic_stiffness", coefficient=1.05)]))
    off = judge("2", hidden, report("missing_physics", [finding("cubic_stiffness", coefficient=-1.0)]))
    other = judge("3", hidden, report("missing_physics", [finding("clearance", coefficient=1.0)]))
    assert (hit.sense_right, hit.inside, hit.ratios) == (True, {"coefficient": True}, {"coefficient": 1.05})
    assert (off.sense_right, off.inside) == (False, {"coefficient": False})
    assert (other.sense_right, other.inside, other.leads) == (None, {}, False)


def test_overlap_of_stretches():
    """Overlap is intersection over union, so a stretch found too long counts as little as one found too short."""
    assert overlap([(4.0, 8.0)], [(4.0, 8.0)]) == 1.0
    assert overlap([(0.0, 8.0)], [(4.0, 8.0)]) == 0.5
    assert overlap([(4.0, 6.0)], [(4.0, 8.0)]) == 0.5
    assert overlap([(4.0, 5.0), (7.0, 10.0)], [(4.0, 8.0)]) == pytest.approx(2.0 / 6.0)
    assert overlap([], [(4.0, 8.0)]) == 0.0


def test_what_is_counted():
    """Shares are of the cases that they speak about, with Wilson's interval; nothing is divided by nothing."""
    judged = [
        judge("1", truth(), named("cubic_stiffness")),
        judge("2", truth(concealed=False, strength=0.005), report("none")),
        judge("3", NOTHING, report("parameters")),
        judge("4", NOTHING, report("unknown")),
        judge("5", OUTSIDE, named("clearance")),
    ]
    score = count(judged)
    assert (score.rates["effects named"].hits, score.rates["effects named"].of) == (1, 2)
    assert score.rates["effects named where 10 nats or more could be gained"].share == 1.0
    assert score.rates["effects named, concealed cases"].share == 1.0
    assert score.rates["none and parameters with a finding"].hits == 1
    assert score.rates["outside the catalogue answered unknown"].share == 0.0
    assert score.rates["faults named"].share is None
    assert score.rates["effects named"].ci95 == pytest.approx((0.0945, 0.9055), abs=1e-3)  # Wilson (1927), 1 of 2
    assert score.confusion == {
        "cubic_stiffness": {"cubic_stiffness": 1, "none": 1},
        "none": {"parameters": 1, "unknown": 1},
        "unknown": {"clearance": 1},
    }
    assert score.by_kind["cubic hardening"] == {"2-5 %": {"right": 1}, "0-2 %": {"missed": 1}}
    assert score.gain_share["median"] == pytest.approx(20.0 / information_nats(truth(), 10.0))
    assert [strength_bin(s) for s in (None, 0.01, 0.02, 0.07)] == ["-", "0-2 %", "2-5 %", "over 5 %"]


def test_what_another_law_does_as_well_is_counted_apart():
    """The bound of all that is told of a force, times the share that no other law has, says whether it can be told."""
    everything = information_nats(truth(), 20.0)
    near = judge("1", {**OUTSIDE, "beyond_nearest": 5.0 / everything}, named("coulomb_friction"))
    apart = judge("2", {**OUTSIDE, "beyond_nearest": 1.0}, report("unknown"))
    assert near.beyond_nats == pytest.approx(5.0)
    assert judge("3", truth(), named("cubic_stiffness")).beyond_nats is None
    rates = count([near, apart]).rates
    assert rates["outside the catalogue answered unknown"].of == 2
    assert rates["of those, unknown where the nearest law is 10 nats away"].of == 1


def test_uniformity_of_p_values_is_tested():
    """p-values of linear cases that are not uniform show as such, map by map."""
    judged = [
        judge(
            str(i),
            NOTHING,
            report(located=Located(maps=[Statistic("time", 0.0, (i + 0.5) / 40), Statistic("lag", 0.0, i / 400)])),
        )
        for i in range(40)
    ]
    uniform = count(judged).p_uniform
    assert uniform["time"] > 0.99
    assert uniform["lag"] < 1e-6


def test_the_seal(tmp_path):
    """A key or a recording that was changed after the sealing is refused with what was promised."""
    cases, key, published = tmp_path / "cases", tmp_path / "key.json", tmp_path / "key.sha256"
    (cases / "0001").mkdir(parents=True)
    (cases / "0001" / "recording.wav").write_bytes(b"sound")
    value = seal({"0001": NOTHING}, cases, key, published)
    assert re.fullmatch("[0-9a-f]{64}", value)
    assert published.read_text() == f"{value}  key.json\n"  # as sha256sum -c reads it
    assert open_key(key, published, cases)["0001"]["kind"] == "nothing"
    (cases / "0001" / "recording.wav").write_bytes(b"other")
    with pytest.raises(InputError, match=r"recording\.wav is not the one that was sealed"):
        open_key(key, published, cases)
    (cases / "0001" / "recording.wav").write_bytes(b"sound")
    key.write_text(key.read_text().replace("nothing", "anything"))
    with pytest.raises(InputError, match=value):
        open_key(key, published, cases)


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    """A proof of two cases, a long one and a short one, by an engine that always says `none`."""
    said: list[str] = []
    proving = Proving(tmp_path_factory.mktemp("proof"), 2, 13, says_nothing)
    return proving, proving.run(said.append), said


def test_the_engine_sees_recording_and_model_only(proof):
    """Beside the recording lies the base model and nothing else, and the model names no term."""
    proving, _, _ = proof
    for name in ("0001", "0002"):
        seen = (proving.out / "diagnoses" / name / "seen.txt").read_text().split("\n")
        assert seen[0] == "model.toml"
        assert seen[1] in ("recording.wav", "recording.flac")
        assert set(seen[2:]) <= {"sensor", "mode", "excitation", "spindle"}


def test_the_hash_is_said_before_the_score(proof):
    """The hash on the terminal is that of the key on disk, and every case has been judged."""
    proving, result, said = proof
    assert result.key_sha256 in said[0]
    assert result.key_sha256 == proving._published.read_text().split()[0]
    assert len(result.judged) == 2
    assert {j.answer for j in result.judged} == {"none"}
    written = json.loads((proving.out / "proof.json").read_text())
    assert written["key_sha256"] == result.key_sha256


def test_a_finished_case_is_not_done_again(proof):
    """Run again, a proof keeps its cases and reports and does only what is missing."""
    proving, result, _ = proof
    kept = proving.out / "diagnoses" / "0001" / "report.json"
    before = kept.stat().st_mtime_ns
    (proving.out / "diagnoses" / "0002" / "report.json").unlink()
    again = proving.run(lambda _: None)
    assert kept.stat().st_mtime_ns == before
    assert again.judged == result.judged
    with pytest.raises(InputError, match="holds another proof"):
        Proving(proving.out, 2, 14, says_nothing).run(lambda _: None)


def test_true_models_are_weighed_once_and_only_effects_of_the_catalogue(proof):
    """The gain of the true model goes into the score of its case, and is not worked out again."""
    proving, result, _ = proof
    weighed = []

    def gauge(recording, model, truth):
        weighed.append((recording.parent.name, model.name, truth["family"]))
        return 12.5

    gauged = Proving(proving.out, 2, 13, says_nothing, gauge=gauge)
    again = gauged.run(lambda _: None)
    effects = [j.case for j in result.judged if j.family == "catalogue"]
    assert effects
    assert weighed == [(case, "model.toml", "catalogue") for case in effects]
    assert {j.case: j.true_gain_nats for j in again.judged if j.true_gain_nats} == dict.fromkeys(effects, 12.5)
    gauged.run(lambda _: None)
    assert len(weighed) == len(effects)


def test_a_proof_that_was_broken_off_is_reported_as_far_as_it_goes(proof, tmp_path):
    """The cases before the first undiagnosed one are scored and shown; of the others nothing is said or done."""
    proving, result, _ = proof
    (tmp_path / "cases").symlink_to(proving.out / "cases")
    for name in ("draw.json", "key.json", "key.sha256"):
        (tmp_path / name).write_bytes((proving.out / name).read_bytes())
    broken_off = Proving(tmp_path, 2, 13, says_nothing, gauge=lambda *_: 12.5)
    with pytest.raises(InputError, match="no case is diagnosed"):
        broken_off.so_far()
    (tmp_path / "diagnoses" / "0002").mkdir(parents=True)
    kept = (proving.out / "diagnoses" / "0002" / "report.json").read_bytes()
    (tmp_path / "diagnoses" / "0002" / "report.json").write_bytes(kept)
    with pytest.raises(InputError, match="no case is diagnosed"):
        broken_off.so_far()  # the second alone may have been chosen
    (tmp_path / "diagnoses" / "0002" / "report.json").unlink()
    (tmp_path / "diagnoses" / "0001").mkdir()
    (tmp_path / "diagnoses" / "0001" / "error.txt").write_text("no engine\n")
    part = broken_off.so_far()
    assert [(j.case, j.outcome) for j in part.judged] == [("0001", "failed")]
    assert (part.cases, part.key_sha256) == (2, result.key_sha256)
    assert json.loads((tmp_path / "proof.json").read_text())["score"]["rates"]["diagnoses that failed"]["of"] == 1
    text = (tmp_path / "proof.html").read_text()
    assert "The first 1 of 2 cases" in text
    assert ">0001<" in text
    assert ">0002<" not in text  # as a cell: the key's hash may hold these digits as well
    assert not (tmp_path / "gains" / "0002.json").exists()
    assert not (tmp_path / "diagnoses" / "0002" / "report.json").exists()


def test_gains_are_counted_as_shares_of_the_true_models():
    """Only effects whose true model gains 10 nats are counted as tellable; the share is that of those named right."""
    hit = report("missing_physics", [finding("cubic_stiffness", coefficient=1.0)], gain_nats=30.0)
    judged = [
        judge("0001", truth(), hit, 40.0),
        judge("0002", truth(), report(), 20.0),
        judge("0003", truth(), report(), 3.0),
    ]
    score = count(judged)
    rate = score.rates["effects named where the true model gains 10 nats"]
    assert (rate.hits, rate.of) == (1, 2)
    assert score.true_gain_share["median"] == pytest.approx(0.75)
    assert any("that of the true model" in line for line in lines(score))


def test_an_engine_that_fails(proof, tmp_path):
    """A diagnosis that raises counts as failed, keeps its traceback, and stops nobody else."""
    proving, _, _ = proof
    (tmp_path / "cases").symlink_to(proving.out / "cases")
    for name in ("draw.json", "key.json", "key.sha256"):
        (tmp_path / name).write_bytes((proving.out / name).read_bytes())
    result = Proving(tmp_path, 2, 13, fails).run(lambda _: None)
    for j in result.judged:
        assert j.answer == ("failed" if j.seconds < 10.0 else "unknown")
        if j.seconds < 10.0:
            assert "too short for me" in (tmp_path / "diagnoses" / j.case / "error.txt").read_text()
    assert {j.answer for j in result.judged} == {"failed", "unknown"}


def test_the_page_holds_everything(proof):
    """The page is self-contained: every picture is in it, every case linked, the hash shown."""
    _, result, _ = proof
    hit = report("missing_physics", [finding("cubic_stiffness", coefficient=1.05)])
    judged = [
        *result.judged,
        judge("0004", truth(parameters={"coefficient": 1.0}), hit),
        judge("0005", NOTHING, report()),
    ]
    text = proof_page(judged, count(judged), result.key_sha256, 13, len(judged))
    assert result.key_sha256 in text
    assert text.count("data:image/png;base64,") == 3
    assert "0.031 (0.035)" in text
    assert not re.search(r'src="(?!data:)', text)
    for j in judged:
        assert f"diagnoses/{j.case}/report.html" in text
    printed = "\n".join(lines(count(judged)))
    assert "effects named" in printed
    assert re.search(r"cubic_stiffness +.*cubic_stiffness 1", printed)


def test_information_is_what_the_path_holds():
    """The bound is the log-likelihood ratio of the path itself, as its own noise gives it (Girsanov), within chance."""
    machine = Machine(400.0, 0.02)
    force = with_strength(machine, Hidden(laws.SQUARE, np.zeros(1), machine.w), "", 0.03, 1.0, 0.0, [1])
    motion = move(machine, force, 20.0, [2], 8)
    x, v, step_s = motion.x, motion.v, 1.0 / (12800 * 8)
    linear = np.column_stack([x, v / machine.w, np.ones_like(x)])
    push = force.p[0] * machine.w**2 * x**2
    rest = push - linear @ np.linalg.lstsq(linear, push, rcond=None)[0]
    noise = np.diff(v) + step_s * (machine.w**2 * x + 2 * 0.02 * machine.w * v + push)[:-1]  # of each step
    ratio = (-rest[:-1] @ noise / machine.intensity) + 0.5 * rest @ rest * step_s / machine.intensity
    hidden = truth(strength=motion.strength, rms_displacement=motion.rms_x)
    expected = information_nats(hidden, 20.0)
    assert abs(ratio - expected) < 4.0 * math.sqrt(2.0 * expected)  # variance of a log-likelihood ratio
    assert expected == pytest.approx(0.5 * rest @ rest * step_s / machine.intensity, rel=0.01)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_command(run, tmp_path):
    """`prove` puts `diagnose` itself to the test: nothing is answered `none`, a softening spring by its name."""
    code, out, err = run("prove", "--cases", 2, "--seed", 13, "--out", tmp_path, "--json")
    score = json.loads(out)
    assert code == 0
    assert (tmp_path / "key.sha256").read_text().split()[0] in err
    assert score["confusion"] == {"none": {"none": 1}, "cubic_stiffness": {"cubic_stiffness": 1}}
    assert score["rates"]["sense right where the name is"]["share"] == 1.0
    assert (tmp_path / "diagnoses" / "0002" / "report.html").exists()
    (tmp_path / "diagnoses" / "0002" / "report.json").unlink()
    code, out, _ = run("prove", "--cases", 2, "--seed", 13, "--out", tmp_path, "--so-far", "--json")
    assert code == 0
    assert json.loads(out)["confusion"] == {"none": {"none": 1}}
