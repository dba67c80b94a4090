"""The command line. What a command needs is imported when it runs, so that ``--help`` is quick."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

if TYPE_CHECKING:
    from chatter_monitor.client import Subscriber
    from chatter_monitor.outlets.event_store import EventStore
    from chatter_monitor.service.archive.dataset import R
    from chatter_monitor.service.archive.kind import Kind

CONFIG = click.option(
    "--config", "configs", type=click.Path(path_type=Path), multiple=True, help="Machine configuration; later ones win."
)
CHANNEL = click.option("--channel", type=click.IntRange(min=0), default=0, show_default=True, help="Counted from 0.")
BETWEEN = click.option(
    "--between", "between_s", type=(float, float), metavar="BEGIN END", help="Stretch to look at, in seconds."
)
JOBS = click.option(
    "--jobs", type=click.IntRange(min=1), help="Processes for an archive; one per processor by default."
)
SCHEDULER = click.option("--scheduler", metavar="ADDRESS", help="A Dask cluster that is to do an archive instead.")
JSON = click.option("--json", "as_json", is_flag=True, help="Print for machines instead of people.")
ALLOWED = "allowed"  # subdirectory of the certificates' directory
DEBUG = click.option("--debug", is_flag=True, expose_value=False, help="Show where an error comes from.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="chatter-monitor")
def cli() -> None:
    """Listen to a machine tool: operational damping and frequency, and whether it chatters."""


@cli.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@CONFIG
@click.option("--spindle-rpm", type=float, help="Spindle speed, if it is known.")
@click.option("--teeth", type=int, help="Cutting edges of the tool (1 for turning).")
@click.option("--model", type=click.Path(path_type=Path), help="Model file to compare the signal with while it runs.")
@click.option("--pace", type=click.Choice(["fast", "real"]), default="fast", help="As fast as possible, or as it was.")
@click.option("--publish", is_flag=True, help="Publish over ZeroMQ as well.")
@click.option(
    "--wait-subscriber",
    type=click.FloatRange(min=0),
    default=0.0,
    metavar="SECONDS",
    help="With --publish: wait so long for a first subscriber, so that it misses nothing.",
)
@click.option("--jsonl", type=click.Path(path_type=Path), help="Write every message to a file of JSON lines.")
@click.option(
    "--odp", "odp_table", type=click.Path(path_type=Path), help="Write every sample's ODPs to a Parquet file."
)
@click.option("--record", type=click.Path(path_type=Path), help="Record events in a directory, as the daemon would.")
@click.option("--out", type=click.Path(path_type=Path), help="An archive's results: a data set of Parquet tables.")
@JOBS
@SCHEDULER
@JSON
@DEBUG
@click.pass_context
def replay(
    context: click.Context,
    files: tuple[str, ...],
    configs: tuple[Path, ...],
    spindle_rpm: float | None,
    teeth: int | None,
    model: Path | None,
    pace: str,
    publish: bool,
    wait_subscriber: float,
    jsonl: Path | None,
    odp_table: Path | None,
    record: Path | None,
    out: Path | None,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Monitor a recording: WAV, FLAC, any rate, any number of channels.

    A recorded event (see `events`) is replayed with the settings that it was recorded with; --config changes them.

    With --out, monitor an archive: files, folders, globs, also as URLs. Run again, it does only what is left to do.
    """
    from chatter_monitor.config import load, merged_tables
    from chatter_monitor.outlets.event_files import recorded_event
    from chatter_monitor.service.replay import Replay

    spindle: dict[str, Any] = {"speed_rpm": spindle_rpm, "teeth": teeth}
    overrides = {"spindle": {key: value for key, value in spindle.items() if value is not None}}
    if model is not None:
        overrides["model"] = {"file": str(model)}
    if out is not None:
        _refuse_given(context, "--out", "model", "pace", "publish", "wait_subscriber", "jsonl", "odp_table", "record")
        from chatter_monitor.service.archive.replays import Replays

        _do_archive(files, Replays(merged_tables(configs, overrides)), out, jobs, scheduler, as_json)
        return
    _refuse_given(context, "a single recording (say --out DIR)", "jobs", "scheduler")
    file = Path(files[0])
    if len(files) > 1 or file.is_dir() or "://" in files[0]:
        is_folder = " Is a directory:" if file.is_dir() else ""
        raise click.UsageError(f"{files[0]}:{is_folder} say with --out DIR where an archive's results go.")
    if recorded_event(file) is not None:
        configs = (file.with_suffix(".json"), *configs)
    settings = load(configs, overrides)
    Replay(
        file=file,
        settings=settings,
        real_time=pace == "real",
        publish=publish,
        wait_subscriber_s=wait_subscriber,
        jsonl=jsonl,
        odp_table=odp_table,
        record=record,
    ).run(as_json=as_json)


def _do_archive(
    files: tuple[str, ...], kind: Kind[R], out: Path, jobs: int | None, scheduler: str | None, as_json: bool
) -> None:
    import msgspec
    from rich.console import Console

    from chatter_monitor.service.archive.archive import PAGE, Archive

    if jobs is not None and scheduler is not None:
        raise click.UsageError("Choose one of --jobs and --scheduler.")
    done = Archive(files, kind, out, jobs, scheduler).run()
    if as_json:
        _print_json({"out": str(out), "done": msgspec.to_builtins(done.done), "broken": done.problems})
    else:
        done.show(Console())
        click.echo(f"wrote {out} and {out / PAGE}")
    if (error := done.error()) is not None:
        raise error


def _is_archive(file: str) -> bool:
    """Whether it may be many recordings: a URL, a folder, a glob that the shell has left alone."""
    path = Path(file)
    return "://" in file or path.is_dir() or (not path.exists() and bool(set("*?[") & set(file)))


def _refuse_given(context: click.Context, what: str, *parameters: str) -> None:
    """Refuse options that make no sense together with what else was said."""
    for parameter in context.command.params:
        given = context.get_parameter_source(str(parameter.name)) is click.core.ParameterSource.COMMANDLINE
        if given and parameter.name in parameters:
            raise click.UsageError(f"{parameter.opts[0]} does not go with {what}.")


@cli.command()
@CONFIG
@DEBUG
def run(configs: tuple[Path, ...]) -> None:
    """Listen to a sound device: the daemon. SIGTERM stops it, SIGHUP has it read its configuration again."""
    import os

    from chatter_monitor.service.daemon import run_daemon
    from chatter_monitor.service.journal import journal

    with journal(os.environ):
        run_daemon(configs, os.environ)


@cli.command()
@CONFIG
@JSON
@DEBUG
def devices(configs: tuple[Path, ...], as_json: bool) -> None:
    """List the sound devices that can be listened to, at which rates, and which one the configuration chooses."""
    import msgspec

    from chatter_monitor.config import load
    from chatter_monitor.service.devices import lines, listing

    found = listing(load(configs))
    if as_json:
        _print_json(msgspec.to_builtins(found))
    else:
        for line in lines(found):
            click.echo(line)
    if not found.devices:
        raise SystemExit(3)


@cli.command()
@click.option("--running", is_flag=True, help="Only ask the running monitor whether it hears (a health check).")
@CONFIG
@JSON
@DEBUG
def doctor(configs: tuple[Path, ...], running: bool, as_json: bool) -> None:
    """Say what is wrong with this installation and what to do about it; exit code 3 if anything is."""
    import msgspec

    from chatter_monitor.config import load
    from chatter_monitor.service import doctor

    findings = []
    for finding in [doctor.running(load(configs))] if running else doctor.examine(configs):
        findings.append(finding)
        if not as_json:
            click.echo(doctor.line(finding))  # as they come: some take seconds
    wrong = any(finding.state == "wrong" for finding in findings)
    if as_json:
        _print_json({"ok": not wrong, "findings": msgspec.to_builtins(findings)})
    if wrong:
        raise SystemExit(3)


@cli.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), required=True, help="Length of the recording.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Same seed, same recording.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Recording to write, .wav or .flac.")
@click.option("--rate", "rate_hz", type=click.IntRange(min=100), help="Hz; the tracker's rate by default.")
@CONFIG
@JSON
@DEBUG
def simulate(
    model: Path, seconds: float, seed: int, out: Path, rate_hz: int | None, configs: tuple[Path, ...], as_json: bool
) -> None:
    """Simulate a machining system; writes the recording and, beside it, the truth as JSON."""
    from chatter_monitor.config import load
    from chatter_monitor.service.modelling import simulate_to_file

    rate_hz = rate_hz or round(load(configs).tracker.sample_rate_hz)
    simulation, truth = simulate_to_file(model, seconds, seed, out, rate_hz)
    rms = float((simulation.signal**2).mean() ** 0.5)
    unstable = simulation.truth.unstable_s
    if as_json:
        _print_json({"recording": str(out), "truth": str(truth), "rms": rms, "unstable_s": unstable})
        return
    spoken = ", ".join(f"{begin:.2f}-{end:.2f} s" for begin, end in unstable) or "nowhere"
    click.echo(f"{out}: {seconds:g} s at {rate_hz} Hz, rms {rms:.3g}; linearly unstable: {spoken}.")
    click.echo(f"{truth}: the truth.")


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Directory for JSON and plots.")
@click.option(
    "--quantity",
    type=click.Choice(["displacement", "velocity", "acceleration"]),
    help="What the recording measures; by default what [input] sensor of --config says (a microphone counts as "
    "velocity, which its pressure follows close to the tool), else displacement, as in the paper.",
)
@CHANNEL
@BETWEEN
@click.option("--band", "band_hz", type=(float, float), metavar="LOW HIGH", help="Band to look at, in Hz.")
@CONFIG
@JSON
@DEBUG
def identify(
    file: Path,
    out: Path | None,
    quantity: Literal["displacement", "velocity", "acceleration"] | None,
    channel: int,
    between_s: tuple[float, float] | None,
    band_hz: tuple[float, float] | None,
    configs: tuple[Path, ...],
    as_json: bool,
) -> None:
    """Find stiffness, damping and excitation of the strongest mode from its response alone."""
    from chatter_monitor.config import load
    from chatter_monitor.energy.report import lines
    from chatter_monitor.service.modelling import QUANTITIES, identify_file

    result, written = identify_file(
        file,
        out,
        channel=channel,
        quantity=quantity or (QUANTITIES[load(configs).input.sensor] if configs else "displacement"),
        between_s=between_s,
        band_hz=band_hz,
    )
    if as_json:
        click.echo(result.to_json())
        return
    for line in lines(result):
        click.echo(line)
    for path in written:
        click.echo(f"wrote {path}")


@cli.command()
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...")
@click.option("--model", type=click.Path(path_type=Path), required=True, help="Model file that is to explain it.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory for report and model.")
@CHANNEL
@BETWEEN
@click.option(
    "--input",
    "driven_by",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Recording of the force, if there is one.",
)
@click.option(
    "--input-channel", type=click.IntRange(min=0), default=0, show_default=True, help="Its channel, counted from 0."
)
@JOBS
@SCHEDULER
@JSON
@DEBUG
@click.pass_context
def diagnose(
    context: click.Context,
    files: tuple[str, ...],
    model: Path,
    out: Path,
    channel: int,
    between_s: tuple[float, float] | None,
    driven_by: Path | None,
    input_channel: int,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Find out where a recording differs from a simulation, and which physics the simulation lacks.

    Writes report.json, report.html and model.toml, the augmented model, which `simulate` runs. Several recordings share
    one machine; a [[cut]] in the model file says at which speed each was recorded.

    Folders, globs and URLs are an archive: each of its recordings is diagnosed by itself, into a data set with a page
    of all. Run again, it does only what is left to do.
    """
    from chatter_monitor.errors import InputError
    from chatter_monitor.service.diagnosing import diagnose_file, diagnose_files, lines

    def progress(step: str) -> None:
        click.echo(f"{step} ...", err=True)

    if any(_is_archive(file) for file in files):
        from chatter_monitor.service.archive.diagnoses import Diagnoses

        _refuse_given(context, "folders, globs and URLs", "driven_by", "input_channel")
        _do_archive(files, Diagnoses.of(model, channel, between_s), out, jobs, scheduler, as_json)
        return
    _refuse_given(context, "single recordings (give their folder)", "jobs", "scheduler")
    recordings = [Path(file) for file in files]
    if len(recordings) > 1:
        if driven_by is not None:
            raise InputError("--input goes with one recording only", got=f"{len(files)} recordings")
        report, written = diagnose_files(
            recordings, model, out, channel=channel, between_s=between_s, progress=progress
        )
    else:
        report, written = diagnose_file(
            recordings[0],
            model,
            out,
            channel=channel,
            between_s=between_s,
            driven_by=driven_by,
            input_channel=input_channel,
            progress=progress,
        )
    if as_json:
        click.echo(report.to_json())
        return
    for line in lines(report):
        click.echo(line)
    for path in written:
        click.echo(f"wrote {path}")


@cli.command()
@click.option("--cases", type=click.IntRange(min=1), default=300, show_default=True, help="How many to draw.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Same seed, same cases.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory; what is done there stays done.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")
@click.option("--so-far", is_flag=True, help="Report the cases that are diagnosed already; diagnose none.")
@JSON
@DEBUG
def prove(cases: int, seed: int, out: Path, jobs: int, so_far: bool, as_json: bool) -> None:
    """Hide physics in recordings, seal the key, diagnose them blindly, open the key, report."""
    from chatter_monitor.reports.proof import lines
    from chatter_monitor.service.diagnosing import diagnose_file, true_gain
    from chatter_monitor.service.proving import Proving

    proving = Proving(out, cases, seed, diagnose_file, jobs, true_gain)
    proof = proving.so_far() if so_far else proving.run(lambda line: click.echo(line, err=as_json))
    if as_json:
        _print_json(proof.score)
        return
    if len(proof.judged) < proof.cases:
        click.echo(f"the first {len(proof.judged)} of {proof.cases} cases; the key's SHA-256 is {proof.key_sha256}")
    for line in lines(proof.score):
        click.echo(line)
    click.echo(f"wrote {out / 'proof.json'} and {out / 'proof.html'}")


@cli.command()
@click.option("--connect", "endpoint", metavar="ENDPOINT", help="Where a monitor publishes; its default by default.")
@click.option("--recording", type=click.Path(path_type=Path), help="Replay a recording onto the dashboard.")
@click.option("--event", "event_id", metavar="ID", help="Show a recorded event of --directory.")
@click.option("--diagnosis", type=click.Path(path_type=Path), metavar="DIR", help="Show what `diagnose` wrote.")
@click.option("--save", type=click.Path(path_type=Path), metavar="X.rrd", help="Write a file, without any viewer.")
@click.option("--browser", "viewer", flag_value="browser", help="Show it in a browser instead of a window.")
@click.option("--no-viewer", "viewer", flag_value="none", help="Open none, only say where one can connect.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Where viewers connect; any free one by default."
)
@click.option(
    "--memory-limit",
    default="500MB",
    show_default=True,
    help="Of the data kept to scroll back, and of the viewer that is opened; the oldest go first.",
)
@click.option("--server-public-key", type=click.Path(path_type=Path), help="Certificate of a monitor that encrypts.")
@click.option("--client-secret-key", type=click.Path(path_type=Path), help="Own secret certificate for it.")
@click.option("--directory", type=click.Path(path_type=Path), help="Recorded events; [recorder] directory by default.")
@CONFIG
@DEBUG
def dashboard(
    endpoint: str | None,
    recording: Path | None,
    event_id: str | None,
    diagnosis: Path | None,
    save: Path | None,
    viewer: Literal["browser", "none"] | None,
    port: int,
    memory_limit: str,
    server_public_key: Path | None,
    client_secret_key: Path | None,
    directory: Path | None,
    configs: tuple[Path, ...],
) -> None:
    """Show what a running monitor publishes, a recording, a recorded event or a diagnosis.

    Needs rerun: pip install 'chatter-monitor[dashboard]'.
    """
    from chatter_monitor.client import Subscriber
    from chatter_monitor.config import load
    from chatter_monitor.outlets.dashboard.place import Place
    from chatter_monitor.outlets.event_files import read
    from chatter_monitor.service.showing import TOPICS, show_diagnosis, show_live, show_recording

    chosen = [what for what in (endpoint, recording, event_id, diagnosis) if what is not None]
    if len(chosen) > 1:
        raise click.UsageError("Choose one of --connect, --recording, --event and --diagnosis.")

    def say(line: str) -> None:
        click.echo(line, err=True)

    place = Place(save, viewer or "window", port, memory_limit)
    if event_id is not None:
        entry = _event_store(directory, configs).find(event_id)
        recording = entry.path / str(read(entry.json).recording)
        configs = (entry.json, *configs)
    if recording is not None:
        show_recording(recording, load(configs), place, say)
    elif diagnosis is not None:
        show_diagnosis(diagnosis, place, say)
    else:
        endpoint = endpoint or load(configs).publish.bind
        with Subscriber(
            endpoint, TOPICS, server_public_key=server_public_key, client_secret_key=client_secret_key
        ) as monitor:
            show_live(monitor.receive, place, endpoint, say)


CONNECT = click.option("--connect", "endpoint", metavar="ENDPOINT", help="Where a monitor publishes.")
SERVER_KEY = click.option(
    "--server-public-key", type=click.Path(path_type=Path), help="Certificate of a monitor that encrypts."
)
CLIENT_KEY = click.option("--client-secret-key", type=click.Path(path_type=Path), help="Own secret certificate for it.")
EVERY = click.option(
    "--every",
    "every_s",
    type=click.FloatRange(min=0),
    default=1.0,
    show_default=True,
    metavar="SECONDS",
    help="How often to tell a state that stays the same; 0 for every message.",
)


@cli.group()
def bridge() -> None:
    """Carry what a monitor publishes into a plant's network, in a process of its own."""


@bridge.command("mqtt")
@click.option("--broker", "address", required=True, metavar="HOST[:PORT]", help="Where to send it.")
@click.option("--prefix", default="chatter-monitor", show_default=True, help="First levels of all topics.")
@click.option("--username", help="Name to log in with.")
@click.option("--password-file", type=click.Path(path_type=Path), help="File with the password, readable by you only.")
@click.option("--tls", is_flag=True, help="Encrypt, and ask the broker for its certificate.")
@click.option("--ca", type=click.Path(path_type=Path), help="Who signed it; those that the system trusts by default.")
@click.option("--cert", "certificate", type=click.Path(path_type=Path), help="Own certificate, if the broker asks.")
@click.option("--key", type=click.Path(path_type=Path), help="Its secret key.")
@click.option(
    "--buffer",
    type=click.IntRange(min=1),
    default=10_000,  # more than an hour of one channel's verdicts and health; about 10 MB
    show_default=True,
    help="Messages kept while the broker is away.",
)
@EVERY
@CONNECT
@SERVER_KEY
@CLIENT_KEY
@CONFIG
@DEBUG
def bridge_to_mqtt(
    address: str,
    prefix: str,
    username: str | None,
    password_file: Path | None,
    tls: bool,
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
    buffer: int,
    every_s: float,
    endpoint: str | None,
    server_public_key: Path | None,
    client_secret_key: Path | None,
    configs: tuple[Path, ...],
) -> None:
    """Send verdicts, events and health to an MQTT broker, as JSON.

    Needs paho-mqtt: pip install 'chatter-monitor[plant]'.
    """
    from chatter_monitor.outlets.mqtt import Broker
    from chatter_monitor.service.bridging import bridge_mqtt

    broker = Broker(address, prefix, buffer, username, password_file, tls, ca, certificate, key)
    with _subscriber(endpoint, configs, server_public_key, client_secret_key) as monitor:
        bridge_mqtt(monitor, broker, every_s, lambda line: click.echo(line, err=True))


@bridge.command("mtconnect")
@click.option("--bind", default="127.0.0.1:7878", show_default=True, help="Where MTConnect agents connect.")
@EVERY
@CONNECT
@SERVER_KEY
@CLIENT_KEY
@CONFIG
@DEBUG
def bridge_to_mtconnect(
    bind: str,
    every_s: float,
    endpoint: str | None,
    server_public_key: Path | None,
    client_secret_key: Path | None,
    configs: tuple[Path, ...],
) -> None:
    """Answer MTConnect agents: an adapter that speaks SHDR."""
    from chatter_monitor.service.bridging import bridge_mtconnect

    with _subscriber(endpoint, configs, server_public_key, client_secret_key) as monitor:
        bridge_mtconnect(monitor, bind, every_s, lambda line: click.echo(line, err=True))


def _subscriber(
    endpoint: str | None, configs: tuple[Path, ...], server_public_key: Path | None, client_secret_key: Path | None
) -> Subscriber:
    from chatter_monitor.client import Subscriber
    from chatter_monitor.service.bridging import TOPICS

    if endpoint is None:
        from chatter_monitor.config import load

        endpoint = load(configs).publish.bind
    return Subscriber(endpoint, TOPICS, server_public_key=server_public_key, client_secret_key=client_secret_key)


class ListingGroup(click.Group):
    """Commands of which ``list`` is meant where none is named."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put ``list`` before arguments that do not begin with a command."""
        if not args or (args[0] not in self.commands and args[0] not in ctx.help_option_names):
            args = ["list", *args]
        return super().parse_args(ctx, args)


EVENTS_DIRECTORY = click.option(
    "--directory", type=click.Path(path_type=Path), help="Where they are; [recorder] directory by default."
)


@cli.group(cls=ListingGroup)
def events() -> None:
    """Recorded events: `events [DIR]` lists them."""


@events.command("list")
@click.argument("directory", metavar="[DIR]", type=click.Path(path_type=Path), required=False)
@CONFIG
@JSON
@DEBUG
def list_events(directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """List the recorded events, oldest first."""
    from chatter_monitor.service.events import described, lines

    store = _event_store(directory, configs)
    if as_json:
        _print_json({"directory": str(store.directory), "events": [described(entry) for entry in store.entries()]})
        return
    for line in lines(store):
        click.echo(line)


@events.command("export")
@click.argument("name", metavar="ID")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory to copy it into.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def export_event(name: str, out: Path, directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """Copy the files of an event: samples, ODPs, JSON."""
    store = _event_store(directory, configs)
    copied = store.export(store.find(name), out)
    if as_json:
        _print_json({"exported": str(copied)})
        return
    click.echo(f"{copied}: exported.")


@events.command("report")
@click.argument("name", metavar="ID")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="HTML file to write.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def report_on_event(name: str, out: Path, directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """Write a page on an event: what happened, when, how sure, what to change."""
    from chatter_monitor.service.reporting import report_event

    report_event(_event_store(directory, configs).find(name), out)
    if as_json:
        _print_json({"report": str(out)})
    else:
        click.echo(f"wrote {out}")


@events.command("shift")
@click.argument("source", metavar="[JSONL|DIR]", type=click.Path(path_type=Path), required=False)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="HTML file to write.")
@CONFIG
@JSON
@DEBUG
def report_on_shift(source: Path | None, out: Path, configs: tuple[Path, ...], as_json: bool) -> None:
    """Write a page on a shift: cutting time, forced, chatter, events, damping over the day.

    From the JSON lines of `replay --jsonl`, or with less to tell from a directory of recorded events, by default
    [recorder] directory.
    """
    from chatter_monitor.service.reporting import report_shift

    shift = report_shift(source or _event_store(None, configs).directory, out)
    if as_json:
        _print_json({"report": str(out), "events": len(shift.events), "seconds_in": shift.seconds})
    else:
        click.echo(f"wrote {out}")


@events.command("purge")
@click.option("--older-than", "days", type=click.FloatRange(min=0), metavar="DAYS", help="Those recorded before that.")
@click.option("--all", "everything", is_flag=True, help="All of them.")
@click.option("--yes", is_flag=True, help="Really; without it, only say what would go.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def purge_events(
    days: float | None, everything: bool, yes: bool, directory: Path | None, configs: tuple[Path, ...], as_json: bool
) -> None:
    """Remove recorded events, but for the protected ones."""
    import time

    from chatter_monitor.service.events import purgeable

    if everything == (days is not None):
        raise click.UsageError("Say which events: either --older-than DAYS or --all.")
    store = _event_store(directory, configs)
    chosen = purgeable(store.entries(), now=time.time(), older_than_days=days)
    if yes:
        for entry in chosen:
            store.remove(entry)
    if as_json:
        _print_json({"chosen": [entry.id for entry in chosen], "removed": yes})
        return
    for entry in chosen:
        click.echo(f"{entry.id}: {'removed' if yes else 'would be removed'}.")
    if not chosen:
        click.echo("Nothing to remove.")
    elif not yes:
        click.echo("Nothing has been removed; say --yes to do it.")


@events.command("protect")
@click.argument("name", metavar="ID")
@click.option("--off", is_flag=True, help="Not any more.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def protect_event(name: str, off: bool, directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """Let neither the quota nor purging remove an event."""
    store = _event_store(directory, configs)
    store.protect(store.find(name), protected=not off)
    if as_json:
        _print_json({"id": name, "protected": not off})
        return
    click.echo(f"{name}: {'not protected any more' if off else 'protected'}.")


def _event_store(directory: Path | None, configs: tuple[Path, ...]) -> EventStore:
    from chatter_monitor.config import load
    from chatter_monitor.outlets.event_store import EventStore

    if directory is None:
        directory = Path(load(configs).recorder.directory)
    return EventStore(directory)


KEYS_DIRECTORY = click.option(
    "--directory",
    type=click.Path(path_type=Path),
    default=Path("~/.config/chatter-monitor/keys"),
    show_default=True,
    callback=lambda _context, _option, path: path.expanduser().absolute(),
    help="Where the certificates are; the allow-list is its subdirectory `allowed`.",
)


@cli.group()
def keys() -> None:
    """CURVE certificates: who the monitor is, and who may listen to it from other machines."""


@keys.command("new")
@click.argument("name")
@KEYS_DIRECTORY
@JSON
@DEBUG
def new_key(name: str, directory: Path, as_json: bool) -> None:
    """Make a certificate: NAME.key to give away, NAME.key_secret to keep."""
    from chatter_monitor.outlets.certificates import new_pair

    public, secret = new_pair(directory, name)
    if as_json:
        _print_json({"public": str(public), "secret": str(secret)})
        return
    click.echo(f"{public}: public; give it to the other side.")
    click.echo(f"{secret}: secret; readable by you only.")
    click.echo(
        f"For a monitor: [publish] server_key = {str(secret)!r}, and `chatter-monitor keys allow` for its clients."
    )
    click.echo("For a client: have its public certificate allowed where the monitor runs.")


@keys.command("allow")
@click.argument("file", type=click.Path(path_type=Path))
@KEYS_DIRECTORY
@JSON
@DEBUG
def allow_key(file: Path, directory: Path, as_json: bool) -> None:
    """Let a client listen: put FILE, its public certificate, on the allow-list."""
    from chatter_monitor.outlets.certificates import allow

    path = allow(file, directory / ALLOWED)
    if as_json:
        _print_json({"allowed": str(path)})
        return
    click.echo(f"{path}: allowed as soon as it connects; remove the file to refuse it again.")
    click.echo(f"For the monitor: [publish] allowed_clients = {str(path.parent)!r}")


@keys.command("list")
@KEYS_DIRECTORY
@JSON
@DEBUG
def list_keys(directory: Path, as_json: bool) -> None:
    """List the certificates made here and the clients that are allowed, with their public keys."""
    from chatter_monitor.outlets.certificates import public_keys

    found = {"own": public_keys(directory), "allowed": public_keys(directory / ALLOWED)}
    if as_json:
        _print_json(found)
        return
    for kind, certificates in found.items():
        for name, key in certificates.items():
            click.echo(f"{kind:<8} {name:<20} {key}")
    if not any(found.values()):
        click.echo(f"No certificates in {directory}; `chatter-monitor keys new NAME` makes one.")


def _print_json(value: object) -> None:
    import msgspec

    click.echo(msgspec.json.encode(value))
