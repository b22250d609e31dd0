"""The command line: `lajolla render`, `check`, `convert`, `compare` and `list`.

Results go to standard output, everything else to standard error. Every error of the user's is one message and
exit code 1; an interrupted command ends with 128 + the signal's number, as in a shell.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import lajolla  # its modules are loaded when they are first used, which no --help does
from lajolla.arguments import STREAMS, UsageError, for_each_sensor, parse, replay_command
from lajolla.display import discard, progress_display, rate, safe_messages, say, size_in_memory
from lajolla.interrupts import Interrupt, Patience, end_at_once, handled_by


def main(words: Sequence[str] | None = None) -> int:
    """Runs one command line (by default the process's own) and returns its exit code."""
    with safe_messages():
        return _reported(lambda: _run_command(_parsed(sys.argv[1:] if words is None else words)))


def _reported(action: Callable[[], int], missing: str = "nothing was written") -> int:
    """Does it; an error is one message and exit code 1, and an interrupt says what is missing."""
    with handled_by(partial(end_at_once, message=missing)):
        try:
            return action()
        except UsageError as error:
            say(f"error: {error}")
        except MemoryError:
            say("error: not enough memory")
        except BrokenPipeError:  # the reader of our output has seen enough, as in `lajolla list | head`
            discard(sys.stdout)
        except (OSError, lajolla.processor.LevelError) as error:
            say(f"error: {error}")
            discard(sys.stdout)
        except KeyboardInterrupt as interrupt:
            say(f"interrupted; {missing}")
            return interrupt.exit_code if isinstance(interrupt, Interrupt) else 130
        except Exception as error:  # a fault of ours, or of a library: one line, as all else
            say(f"error: {type(error).__name__}: {next(iter(str(error).splitlines()), '')}")
        return 1


def _parsed(words: Sequence[str]) -> argparse.Namespace:
    try:
        return parse(words)
    except SystemExit:  # of --help, which may have had nowhere to go
        sys.stdout.flush()
        raise


def _run_command(arguments: argparse.Namespace) -> int:
    """Runs a command; an error in a scene, an option or a picture is one message."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy would start threads that spin for nothing
    # This loads the renderer, outside of the block whose handlers need it: the user may interrupt already.
    refusals = (lajolla.OptionError, lajolla.ImageError, lajolla._core.DescriptionError)
    try:
        code = COMMANDS[arguments.command](arguments)
        sys.stdout.flush()
        return code
    except lajolla.SceneError as error:
        print(error, file=sys.stderr)
    except refusals as error:
        say(f"error: {error}")
    return 1


def load(arguments: argparse.Namespace, path: Path | None = None) -> lajolla.Scene:
    """Opens the scene of a command line, or another one with its options."""
    return lajolla.load(
        path or arguments.scene,
        parameters=dict(arguments.parameters),
        strict=arguments.strict,
        two_sided=arguments.two_sided,
        spp=arguments.spp,
        size=arguments.size,
        crop=arguments.crop,
        seed=arguments.seed,
        integrator=arguments.integrator,
        max_depth=arguments.max_depth,
        sensor=arguments.sensor,
    )


# --- render -------------------------------------------------------------------------------------------------


def command_render(arguments: argparse.Namespace) -> int:
    if arguments.all_sensors:
        return _render_each_sensor(arguments)
    outputs = list(dict.fromkeys(arguments.outputs or []))
    if arguments.pixel is None:
        _check_outputs(arguments)
    scene = load(arguments)
    for warning in scene.warnings:
        print(warning, file=sys.stderr)
    if arguments.pixel is not None:
        print(*scene.radiance(*arguments.pixel, arguments.sample))
        return 0
    outputs = outputs or [
        Path(arguments.scene.stem + arguments.suffix + ending) for ending in scene.film.endings
    ]
    for output in outputs:
        lajolla.image.check_output(output)
        lajolla.image.check_space(output, scene.width, scene.height, 3 + len(scene.core.channels))
    holding = lajolla.image.HOLD_CHANNELS
    if scene.core.channels and not any(output.suffix.lower() in holding for output in outputs):
        say(f"warning: only {' and '.join(holding)} files hold all channels of this scene")
    rendering = scene.rendering(threads=arguments.threads)
    patience = Patience("the picture")
    with handled_by(patience):
        with (
            suppress(Interrupt),
            progress_display(pixels=scene.width * scene.height, quiet=arguments.quiet) as observe,
        ):
            rendering.run(patience.stopping(observe))
        if rendering.samples == 0 and patience.interrupt is not None:
            raise patience.interrupt
        patience.save(_save, outputs, scene, rendering, arguments)
        names = ", ".join(str(output) for output in outputs)
        if patience.interrupt is not None:
            say(f"interrupted; wrote {names} with {rendering.samples} of {rendering.spp} samples per pixel")
            return patience.interrupt.exit_code
        if not arguments.quiet:
            say(f"wrote {names} ({_summary(scene, rendering)})")
    return 0


def _check_outputs(arguments: argparse.Namespace) -> None:
    """What would fail after hours of rendering fails now."""
    for output in arguments.outputs or []:
        lajolla.image.check_output(output)
    if arguments.stats is not None and str(arguments.stats) not in STREAMS:
        lajolla.whole_files.check_folder(arguments.stats)


def _save(
    outputs: Sequence[Path],
    scene: lajolla.Scene,
    rendering: lajolla.Rendering,
    arguments: argparse.Namespace,
) -> None:
    """Writes all that a render was asked for."""
    _write_outputs(outputs, rendering.image(), arguments)
    _report_nonfinite(rendering, arguments)
    if arguments.stats is not None:
        _write_stats(arguments.stats, statistics(scene, rendering))


def _render_each_sensor(arguments: argparse.Namespace) -> int:
    """Renders what can be rendered, until an interrupt; an error names its sensor."""
    names = lajolla.scene.sensor_names(arguments.scene, parameters=dict(arguments.parameters))
    commands = for_each_sensor(arguments, names)
    for command in commands:
        _check_outputs(command)
    if len(commands) == 1:
        return command_render(commands[0])
    result = 0
    for name, command in zip(names, commands, strict=True):
        missing = f"nothing was written of sensor {name} and those after it"
        code = _reported(partial(_run_command, command), missing)
        if code > 1:  # an interrupt's
            return code
        if code == 1:
            say(f"sensor {name} failed")
            result = 1
    return result


def _write_outputs(outputs: Sequence[Path], picture: lajolla.Image, arguments: argparse.Namespace) -> None:
    """Writes all that can be written, then raises the first error."""
    errors = []
    if arguments.tonemap is not None:
        picture.film = replace(picture.film, tonemap_method=arguments.tonemap)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", lajolla.ImageWarning)
        for output in outputs:
            try:
                picture.save(output, exposure=arguments.exposure, half=arguments.half)
            except lajolla.ImageError as error:
                errors.append(error)
    for warning in caught:
        say(f"warning: {warning.message}")
    if errors:
        raise errors[0]


def _summary(scene: lajolla.Scene, rendering: lajolla.Rendering) -> str:
    stats = statistics(scene, rendering)
    return (
        f"{rendering.samples} samples per pixel in {rendering.seconds:.1f} s, "
        f"{rate(stats['samples_per_second'], 'samples')}, {rate(stats['rays_per_second'], 'rays')}"
    )


def _report_nonfinite(rendering: lajolla.Rendering, arguments: argparse.Namespace) -> None:
    count = rendering.accumulator.nonfinite
    if count == 0:
        return
    x, y, sample = rendering.accumulator.nonfinite_list[0]
    say(f"warning: {count} sample{'s were' if count > 1 else ' was'} not finite and count as black")
    say(f"the first is sample {sample} of pixel {x},{y}: {replay_command(arguments, x, y, sample)}")


def statistics(scene: lajolla.Scene, rendering: lajolla.Rendering) -> dict[str, Any]:
    """What --stats writes; `samples` counts camera paths, in all pixels together."""
    samples = rendering.samples * scene.width * scene.height
    seconds = max(rendering.seconds, 1e-9)
    unit = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss
    return {
        "width": scene.width,
        "height": scene.height,
        "samples_per_pixel": rendering.samples,
        "threads": rendering.threads,
        "load_seconds": scene.load_seconds,
        "build_seconds": scene.build_seconds,
        "render_seconds": rendering.seconds,
        "samples": samples,
        "samples_per_second": samples / seconds,
        "rays_per_second": rendering.accumulator.rays / seconds,
        "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit,
        "nonfinite_samples": rendering.accumulator.nonfinite,
    }


def _write_stats(path: Path, stats: dict[str, Any]) -> None:
    text = json.dumps(stats, indent=2) + "\n"
    if str(path) in STREAMS:  # opening these anew would cut off a file that they lead to
        stream: TextIO = getattr(sys, STREAMS[str(path)])
        stream.write(text)
    else:
        with lajolla.whole_files.replacing(path) as temporary:
            temporary.write_text(text)


# --- convert, check, compare, list --------------------------------------------------------------------------


def command_convert(arguments: argparse.Namespace) -> int:
    target: Path = arguments.target
    if target.exists() and arguments.scene.exists() and target.samefile(arguments.scene):
        raise UsageError(f"{target} is the scene itself; name another file to write")
    lajolla.whole_files.check_folder(target)
    parameters = dict(arguments.parameters)
    result = lajolla.scene.convert(
        arguments.scene, target, parameters=parameters, strict=arguments.strict, pack=arguments.pack
    )
    for warning in result.warnings:
        print(warning, file=sys.stderr)
    patience = Patience("the scene")
    with handled_by(patience):
        patience.save(_write_export, target, result)
    written = str(target)
    if result.files:
        count, folder = len(result.files), Path(next(iter(result.files))).parent
        written += f" and {count} file{'s' if count > 1 else ''} in {folder}"
    if patience.interrupt is not None:
        say(f"interrupted; wrote {written}")
        return patience.interrupt.exit_code
    say(f"wrote {written}")
    return 0


def _write_export(target: Path, result: lajolla.scene.Export) -> None:
    """Writes all files under other names before the first takes its place: old and new ones do not fit."""
    for folder in {Path(name).parent for name in result.files}:
        (target.parent / folder).mkdir(exist_ok=True)
    replacing = lajolla.whole_files.replacing
    with ExitStack() as replacements:
        temporary = replacements.enter_context(replacing(target))  # the last to take its place
        temporary.write_text(result.text, encoding="utf-8")
        for name, content in result.files.items():
            temporary = replacements.enter_context(replacing(target.parent / name))
            if isinstance(content, bytes):
                temporary.write_bytes(content)
            else:
                lajolla.image.write(temporary, content)


def command_check(arguments: argparse.Namespace) -> int:
    if arguments.all:
        return _check_all(arguments)
    scene = load(arguments)
    summary = dict(scene.core.summary())
    facts = {"picture": f"{scene.width} x {scene.height}, {scene.core.sample_count} samples per pixel"}
    if "bytes" in summary:
        facts["memory"] = size_in_memory(summary.pop("bytes"))
    facts = {**{name: f"{value:,}" for name, value in summary.items()}, **facts}
    width = max(len(name) for name in facts)
    for name, value in facts.items():
        print(f"{name:{width}}  {value}")
    for warning in scene.warnings:
        print(warning)
    print(f"{'warnings':{width}}  {len(scene.warnings)}")
    return 0


def _check_all(arguments: argparse.Namespace) -> int:
    if not arguments.scene.is_dir():
        raise UsageError(f"{arguments.scene} is no folder; --all opens every scene below a folder")
    findings = lajolla.survey.survey(arguments.scene, lambda path: load(arguments, path))
    for line in lajolla.survey.table(arguments.scene, findings):
        print(line)
    return 1 if any(finding.error for finding in findings) else 0


def command_compare(arguments: argparse.Namespace) -> int:
    if arguments.diff is not None:
        lajolla.image.check_output(arguments.diff)
        if arguments.diff.suffix.lower() not in lajolla.image.LOW_RANGE:
            raise lajolla.ImageError(f"{arguments.diff}: the difference picture is a PNG or JPEG")
    a, b = lajolla.image.read(arguments.a), lajolla.image.read(arguments.b)
    result = lajolla.comparison.compare(a, b)
    print(f"{'':12}  {'red':>12}  {'green':>12}  {'blue':>12}")
    for name, values in (
        ("mean ratio", result.mean_ratio),
        ("RMSE", result.rmse),
        ("relative MSE", result.relative_mse),
    ):
        print(f"{name:12}  " + "  ".join(f"{value:12.6g}" for value in values))
    if result.excluded:
        say(f"warning: {result.excluded} pixels are not finite and were excluded")
    if arguments.diff is not None:
        lajolla.image.write_encoded(arguments.diff, lajolla.comparison.difference_picture(a, b))
    return 0


def command_list(arguments: argparse.Namespace) -> int:
    for line in lajolla.catalog.listing(arguments.kind, arguments.name):
        print(line)
    return 0


COMMANDS = {
    "render": command_render,
    "check": command_check,
    "convert": command_convert,
    "compare": command_compare,
    "list": command_list,
}
