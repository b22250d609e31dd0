"""The command line: `lajolla render`, `denoise`, `check` and so on.

Results go to standard output, everything else to standard error. Every error of the user's is one message and
exit code 1; an interrupted command ends with 128 + the signal's number, as in a shell.
"""

from __future__ import annotations

import argparse
import io
import math
import os
import resource
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO

import lajolla  # its modules are loaded when they are first used, which no --help does
from lajolla.arguments import (
    UsageError,
    for_each_sensor,
    is_standard_output,
    parse,
    prints_results,
    replay_command,
)
from lajolla.display import (
    Observer,
    coloured,
    discard,
    is_closed,
    print_message,
    progress_display,
    rate,
    safe_messages,
    say,
)
from lajolla.interrupts import Interrupt, Patience, end_at_once, handled_by

TYPE_CHECKING = False  # as in `lajolla`
if TYPE_CHECKING:
    from lajolla.colour import FloatImage

SAVING_SECONDS = 60.0  # between two checkpoints
LEAST_MEMORY = (
    384 << 20
)  # of addresses: the libraries take most of it when they are loaded, and abort without


def main(words: Sequence[str] | None = None) -> int:
    """Runs a command line (by default that of the process) and returns the exit code."""
    with safe_messages():
        return _reported(lambda: _run_command(_parsed(sys.argv[1:] if words is None else words)))


def _reported(action: Callable[[], int], missing: str = "nothing was written") -> int:
    """Runs a command; errors become one message and exit code 1, interrupts report what is incomplete."""
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


def _check_memory_limit() -> None:
    """Raises an error if there is too little memory for the libraries, because some of them would abort."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        limits = f"the limit (ulimit -v) is {limit >> 20} MiB, the minimum {LEAST_MEMORY >> 20} MiB"
        raise UsageError(f"not enough memory: {limits}")


def _run_command(arguments: argparse.Namespace) -> int:
    """Runs a command; an error of a scene, option or picture becomes one message."""
    _check_memory_limit()
    if prints_results(arguments) and is_closed(sys.stdout):
        raise UsageError("standard output is closed, and the result belongs there")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy would start threads that spin for nothing
    # This loads the renderer, outside of the block whose handlers need it: the user may interrupt already.
    refusals = (
        *(lajolla.OptionError, lajolla.ImageError, lajolla.ClusterError),
        lajolla._core.DescriptionError,
    )
    try:
        code = COMMANDS[arguments.command](arguments)
        sys.stdout.flush()
        return code
    except lajolla.SceneError as error:
        print_message(error)
    except refusals as error:
        say(f"error: {error}")
    return 1


def load(arguments: argparse.Namespace, path: Path | None = None) -> lajolla.Scene:
    """Opens the scene of a command line, or another one with its options; prints no warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.LajollaWarning)
        return lajolla.load(
            path or _scene(arguments),
            parameters=dict(arguments.parameters),
            strict=arguments.strict,
            two_sided=arguments.two_sided,
            spp=arguments.spp,
            size=arguments.size,
            crop=arguments.crop,
            seed=arguments.seed,
            sampler=arguments.sampler,
            integrator=arguments.integrator,
            max_depth=arguments.max_depth,
            sensor=arguments.sensor,
            hide_emitters=arguments.hide_emitters,
            aovs=arguments.aovs,
        )


def _scene(arguments: argparse.Namespace) -> Path | BinaryIO:
    """The scene's file, or the content of standard input, which can be read only once."""
    if str(arguments.scene) != "-":
        return arguments.scene
    if arguments.standard_input is None:
        arguments.standard_input = sys.stdin.buffer.read()
    stream = io.BytesIO(arguments.standard_input)
    stream.name = "<stdin>"  # for messages
    return stream


# --- render -------------------------------------------------------------------------------------------------


def command_render(arguments: argparse.Namespace) -> int:
    if arguments.all_sensors:
        return _render_each_sensor(arguments)
    if arguments.pixel is None:
        lajolla.outputs.check(arguments)
    if arguments.denoise:
        lajolla.denoising.check_available()
    scene = load(arguments)
    for warning in scene.warnings:
        print_message(warning)
    if arguments.pixel is not None:
        x, y = arguments.pixel
        print(*scene.radiance(x, y, arguments.sample))
        return 0
    outputs = _checked_outputs(scene, arguments)
    rendering = scene.rendering(
        spp=arguments.spp,
        seconds=arguments.time,
        noise=arguments.noise,
        adaptive=arguments.adaptive,
        threads=arguments.threads,
        first_sample=arguments.first_sample,
        cluster=arguments.cluster,
        mixed=arguments.mixed,
    )
    if arguments.resume is not None:
        lajolla.checkpoint.resume(rendering, arguments.resume)
    return _run_and_save(outputs, scene, rendering, arguments)


def _checked_outputs(scene: lajolla.Scene, arguments: argparse.Namespace) -> list[lajolla.outputs.Output]:
    """The pictures to be written; raises ImageError if one of them cannot be written."""
    outputs = lajolla.outputs.outputs_of(arguments, scene.film)
    lajolla.outputs.check_distinct(arguments, outputs)
    for output in outputs:
        output.check()
        output.check_space(scene, layers=9 if arguments.denoise else 0)
        output.check_layers(scene, arguments)
    has_more = scene.core.channels or scene.aovs
    if has_more and not any(output.holds_channels for output in outputs):
        *some, last = lajolla.picture_formats.HOLD_CHANNELS
        say(f"warning: only {', '.join(some)} and {last} files hold all channels")
    return outputs


def _run_and_save(
    outputs: Sequence[lajolla.outputs.Output],
    scene: lajolla.Scene,
    rendering: lajolla.Rendering,
    arguments: argparse.Namespace,
) -> int:
    """Renders, and saves what there is at the end, after an interrupt, or after an error."""
    file = arguments.checkpoint
    saver = lajolla.checkpoint.Saver(rendering, file, arguments.every or SAVING_SECONDS) if file else None
    displayed = partial(progress_display, pixels=scene.width * scene.height, quiet=arguments.quiet)
    patience = Patience("the picture")
    features = None
    failure: Exception | None = None
    with handled_by(patience):
        try:
            with suppress(Interrupt), _warnings_printed():
                if arguments.denoise:  # first, so that an interrupted picture can be denoised too
                    with displayed(label="features: ") as observe:
                        features = scene.features(
                            threads=arguments.threads, observe=patience.stopping(observe)
                        )
                with displayed() as observe:
                    rendering.run(patience.stopping(_saving(saver, observe)))
        except Exception as error:  # whatever it is, the samples so far are saved
            failure = error
        problem = failure or patience.interrupt
        if rendering.samples == 0 and problem is not None:
            raise problem
        patience.save(_save, outputs, scene, rendering, features, arguments, saver)
    written = f"wrote {', '.join(map(str, outputs))} ({_summary(scene, rendering)})"
    if failure is not None:
        say(written)
        raise failure
    if patience.interrupt is not None:
        say(f"interrupted; {written}")
        return patience.interrupt.exit_code
    if not arguments.quiet:
        say(written)
    return 0


@contextmanager
def _warnings_printed() -> Iterator[None]:
    """Prints warnings of the package as they come, in one line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", lajolla.LajollaWarning)
        warnings.showwarning = lambda message, *rest: say(f"warning: {message}")
        yield


def _saving(saver: lajolla.checkpoint.Saver | None, observe: Observer) -> Observer:
    """An observer that also writes checkpoints when they are due; an error is told, and rendering goes on."""
    if saver is None:
        return observe

    def observe_and_save(progress: lajolla.Progress) -> None:
        observe(progress)
        if (error := saver.write_if_due()) is not None:
            say(f"warning: {error}")

    return observe_and_save


def _save(
    outputs: Sequence[lajolla.outputs.Output],
    scene: lajolla.Scene,
    rendering: lajolla.Rendering,
    features: Mapping[str, FloatImage] | None,
    arguments: argparse.Namespace,
    saver: lajolla.checkpoint.Saver | None,
) -> None:
    """Writes all outputs of a render, denoised if there are features."""
    failures: list[Exception] = []
    if saver is not None:  # first, as nothing can be computed again without it
        try:
            saver.write()
        except lajolla.ImageError as problem:
            failures.append(problem)
    picture = rendering.image()
    if features is None and arguments.denoise:
        say("warning: the picture is not denoised, because its features were not finished")
    elif features is not None:
        try:
            picture = picture.denoise(features, threads=arguments.threads)
        except lajolla.DenoiseError as problem:
            failures.append(lajolla.DenoiseError(f"{problem}; the picture was saved as rendered"))
    lajolla.outputs.write_pictures(outputs, picture, arguments)
    _report_nonfinite(rendering, arguments)
    if arguments.stats is not None:
        stats = lajolla.outputs.statistics(scene, rendering)
        lajolla.outputs.write_statistics(arguments.stats, stats)
    for failure in failures[:-1]:
        say(f"error: {failure}")
    if failures:
        raise failures[-1]


def _render_each_sensor(arguments: argparse.Namespace) -> int:
    """Renders all sensors until an interrupt; errors name the sensor."""
    names = lajolla.scene.sensor_names(_scene(arguments), parameters=dict(arguments.parameters))
    commands = for_each_sensor(arguments, names)
    for command in commands:
        lajolla.outputs.check(command)
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


def _summary(scene: lajolla.Scene, rendering: lajolla.Rendering) -> str:
    stats = lajolla.outputs.statistics(scene, rendering)
    missing = f" of {rendering.rules.spp}" if rendering.samples < (rendering.rules.spp or 0) else ""
    samples = f"{rendering.samples:.4g}{missing} samples per pixel"
    if stats["fewest_samples"] < stats["most_samples"]:
        samples += f" ({stats['fewest_samples']} to {stats['most_samples']})"
    noise = f"noise {rendering.noise:.2g}, " if math.isfinite(rendering.noise) else ""
    return (
        f"{samples} in {rendering.seconds:.1f} s, {noise}"
        f"{rate(stats['samples_per_second'], 'samples')}, {rate(stats['rays_per_second'], 'rays')}"
    )


def _report_nonfinite(rendering: lajolla.Rendering, arguments: argparse.Namespace) -> None:
    count = rendering.accumulator.nonfinite
    if count == 0 or not rendering.accumulator.nonfinite_list:
        return
    x, y, sample = rendering.accumulator.nonfinite_list[0]
    say(f"warning: {count} sample{'s were' if count > 1 else ' was'} not finite and count as black")
    say(f"the first is sample {sample} of pixel {x},{y}: {replay_command(arguments, x, y, sample)}")


def command_merge(arguments: argparse.Namespace) -> int:
    outputs = lajolla.outputs.outputs_of(arguments)
    lajolla.outputs.check(arguments)
    lajolla.outputs.check_distinct(arguments, outputs)
    if len(set(arguments.files)) < len(arguments.files):
        raise UsageError("a checkpoint is named twice")
    files = {path: lajolla.checkpoint.read(path) for path in arguments.files}
    result = lajolla.checkpoint.merged(files)
    if result.left_out:
        say(f"warning: {', '.join(result.left_out)} left out, which only a render of the scene can compute")
    lajolla.outputs.write_pictures(outputs, result.image(), arguments)
    if arguments.checkpoint is not None:
        result.write(arguments.checkpoint)
    written = [*map(str, outputs), *([str(arguments.checkpoint)] if arguments.checkpoint else [])]
    say(f"wrote {', '.join(written)} ({int(result.counts.max())} samples per pixel)")
    return 0


def command_view(arguments: argparse.Namespace) -> int:
    from lajolla.viewer.command import view  # here, as other commands need no server

    return view(arguments, lambda: load(arguments))


# --- denoise, convert, check, compare, list -----------------------------------------------------------------


def command_denoise(arguments: argparse.Namespace) -> int:
    lajolla.denoising.check_available()
    outputs = lajolla.outputs.outputs_of(arguments)
    for output in outputs:
        output.check()
    source = sys.stdin.buffer if str(arguments.picture) == "-" else arguments.picture
    picture = lajolla.Image.open(source)
    patience = Patience("the picture")
    with handled_by(patience):
        patience.save(_denoise, outputs, picture, arguments)
    if not arguments.quiet:
        say(f"wrote {', '.join(str(output) for output in outputs)}")
    return patience.interrupt.exit_code if patience.interrupt is not None else 0


def _denoise(
    outputs: Sequence[lajolla.outputs.Output], picture: lajolla.Image, arguments: argparse.Namespace
) -> None:
    denoised = picture.denoise(threads=arguments.threads)
    lajolla.outputs.write_pictures(outputs, denoised, arguments)


def command_convert(arguments: argparse.Namespace) -> int:
    target = Path("-") if is_standard_output(arguments.target) else arguments.target
    if str(target) != "-":
        lajolla.whole_files.check_folder(target)
        if str(arguments.scene) != "-" and _same_file(target, arguments.scene):
            raise UsageError(f"{target} is the scene itself; name another file to write")
    parameters = dict(arguments.parameters)
    result = lajolla.scene.convert(
        _scene(arguments), target, parameters=parameters, strict=arguments.strict, pack=arguments.pack
    )
    for warning in result.warnings:
        print_message(warning)
    if str(target) == "-" and result.files:
        needed = f"files beside the scene, such as {next(iter(result.files))}"
        raise UsageError(f"this scene needs {needed}; name a file instead of standard output")
    patience = Patience("the scene")
    with handled_by(patience):
        patience.save(_write_export, target, result)
    written = "standard output" if str(target) == "-" else str(target)
    if result.files:
        count, folder = len(result.files), Path(next(iter(result.files))).parent
        written += f" and {count} file{'s' if count > 1 else ''} in {folder}"
    if patience.interrupt is not None:
        say(f"interrupted; wrote {written}")
        return patience.interrupt.exit_code
    say(f"wrote {written}")
    return 0


def _same_file(a: Path, b: Path) -> bool:
    return os.path.exists(a) and os.path.exists(b) and os.path.samefile(a, b)


def _write_export(target: Path, result: lajolla.scene.Export) -> None:
    """Writes all files under temporary names before renaming the first: old and new files do not match."""
    for folder in {Path(name).parent for name in result.files}:
        (target.parent / folder).mkdir(exist_ok=True)
    replacing = lajolla.whole_files.replacing
    with ExitStack() as replacements:
        # The last to take its place.
        stream_or_path = sys.stdout.buffer if str(target) == "-" else target
        temporary = replacements.enter_context(lajolla.whole_files.written_to(stream_or_path, ".xml"))
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
    try:
        scene = load(arguments)
    except (lajolla.SceneError, lajolla.OptionError) as problem:
        if arguments.json:
            print(lajolla.report.as_text(lajolla.report.refused(arguments.scene, problem)))
        raise
    facts = lajolla.report.scene_facts(arguments.scene, scene)
    if arguments.json:
        print(lajolla.report.as_text(facts))
        return 0
    lines = dict(lajolla.report.scene_lines(facts))
    width = max(len(name) for name in ("warnings", *lines))
    for name, value in lines.items():
        print(f"{name:{width}}  {value}")
    for warning in scene.warnings:
        print(coloured(str(warning), sys.stdout))
    print(f"{'warnings':{width}}  {len(scene.warnings)}")
    return 0


def _check_all(arguments: argparse.Namespace) -> int:
    if not os.path.isdir(arguments.scene):
        raise UsageError(f"{arguments.scene} is no folder; --all opens every scene below a folder")
    findings = lajolla.survey.survey(arguments.scene, lambda path: load(arguments, path))
    if arguments.json:
        print(lajolla.report.as_text(lajolla.report.folder_facts(arguments.scene, findings)))
    else:
        for line in lajolla.survey.table(arguments.scene, findings):
            print(line)
    return 1 if any(finding.error for finding in findings) else 0


def command_compare(arguments: argparse.Namespace) -> int:
    if arguments.diff is not None:
        lajolla.image.check_output(arguments.diff)
        if arguments.diff.suffix.lower() not in lajolla.picture_formats.LOW_RANGE:
            raise lajolla.ImageError(f"{arguments.diff}: the difference picture is a PNG, JPEG or the like")
    a, b = (
        lajolla.image.read(sys.stdin.buffer if str(path) == "-" else path)
        for path in (arguments.a, arguments.b)
    )
    facts = lajolla.report.comparison_facts(arguments.a, arguments.b, lajolla.comparison.compare(a, b))
    if arguments.json:
        print(lajolla.report.as_text(facts))
    else:
        for line in lajolla.report.comparison_lines(facts):
            print(line)
    if facts["excluded_pixels"]:
        say(f"warning: {facts['excluded_pixels']} pixels are not finite and were excluded")
    if arguments.diff is not None:
        lajolla.image.write_encoded(arguments.diff, lajolla.comparison.difference_picture(a, b))
    return 0


def command_list(arguments: argparse.Namespace) -> int:
    for line in lajolla.catalog.listing(arguments.kind, arguments.name):
        print(line)
    return 0


def command_completion(arguments: argparse.Namespace) -> int:
    print(lajolla.completion.script(arguments.shell))
    return 0


COMMANDS = {
    "render": command_render,
    "view": command_view,
    "denoise": command_denoise,
    "check": command_check,
    "convert": command_convert,
    "compare": command_compare,
    "merge": command_merge,
    "list": command_list,
    "completion": command_completion,
}
