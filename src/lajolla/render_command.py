"""`lajolla render`, `batch` and `merge`."""

from __future__ import annotations

import argparse
import io
import math
import shlex
import sys
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import lajolla  # its modules are loaded when they are first used, which no --help does
from lajolla.arguments import UsageError, parse, replay_command
from lajolla.command_errors import explained, reported
from lajolla.display import Observer, print_message, progress_display, rate, say
from lajolla.interrupts import Interrupt, Patience, end_at_once, handled_by

TYPE_CHECKING = False  # as in `lajolla`
if TYPE_CHECKING:
    from lajolla.colour import FloatImage
    from lajolla.series import Render
    from lajolla.tev import Tev

SAVING_SECONDS = 60.0  # between two checkpoints


def load(arguments: argparse.Namespace, path: Path | None = None) -> lajolla.Scene:
    """Opens the scene of a command line, or another one with its options; prints no warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.LajollaWarning)
        scene = lajolla.load(
            path or scene_file(arguments),
            reuse=arguments.previous.scene if arguments.previous else None,
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
            strategy=arguments.strategy,
            footprint=arguments.footprint,
            sensor=arguments.sensor,
            hide_emitters=arguments.hide_emitters,
            robust=arguments.robust,
            aovs=arguments.aovs,
        )
    if arguments.sensor is None and len(scene.sensors) > 1:
        listed = f"the scene has {len(scene.sensors)} sensors, {', '.join(scene.sensors)}"
        scene.warnings.append(lajolla.SceneWarning(f'{listed}; "{scene.sensor}" is used'))
    if arguments.previous:
        arguments.previous.scene = scene
    return scene


def scene_file(arguments: argparse.Namespace) -> Path | BinaryIO:
    """The scene's file, or the content of standard input, which can be read only once."""
    if str(arguments.scene) != "-":
        return arguments.scene
    if arguments.standard_input is None:
        arguments.standard_input = sys.stdin.buffer.read()
    stream = io.BytesIO(arguments.standard_input)
    stream.name = "<stdin>"  # for messages
    return stream


# --- render


def command_render(arguments: argparse.Namespace) -> int:
    if arguments.frames is not None:
        return _render_each_frame(arguments)
    if arguments.all_sensors:
        return _render_each_sensor(arguments)
    if arguments.skip_existing and all(path.exists() for path in arguments.outputs):
        if not arguments.quiet:
            there = ", ".join(map(str, arguments.outputs))
            say(f"not rendered again: {there}")
        return 0
    if arguments.pixel is None:
        lajolla.outputs.check(arguments)
    if arguments.denoise:
        lajolla.denoising.check_available()
    tev = (
        None
        if arguments.tev is None
        else lajolla.tev.Tev(arguments.tev, lambda text: say(f"warning: {text}"))
    )
    scene = load(arguments)
    for warning in scene.warnings:
        print_message(warning)
    if arguments.pixel is not None:
        x, y = arguments.pixel
        print(*scene.radiance(x, y, arguments.sample))
        return 0
    outputs = _checked_outputs(scene, arguments)
    with _warnings_printed():
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
        _warn_of_more_samples(rendering, arguments)
    name = str(outputs[0])
    shown = [] if tev is None else [partial(_show_in_tev, tev, name, rendering)]
    written: list[str] = []
    if not arguments.view:
        return _run_and_save(outputs, scene, rendering, arguments, tev, shown, written)
    from lajolla.viewer.during_render import page_of_render  # here, as other renders need no server

    with page_of_render(scene, rendering, arguments, written) as observe:
        return _run_and_save(outputs, scene, rendering, arguments, tev, [*shown, observe], written)


def _warn_of_more_samples(rendering: lajolla.Rendering, arguments: argparse.Namespace) -> None:
    spp = rendering.rules.spp
    if spp is not None and rendering.samples > spp:
        count = f"{rendering.samples:.4g} samples per pixel"
        say(f"warning: {arguments.resume} has {count}, more than --spp {spp}; all are used")


def _checked_outputs(scene: lajolla.Scene, arguments: argparse.Namespace) -> list[lajolla.outputs.Output]:
    """The pictures to be written; raises ImageError if one of them cannot be written."""
    outputs = lajolla.outputs.outputs_of(arguments, scene.film)
    lajolla.outputs.check_distinct(arguments, outputs)
    for output in outputs:
        output.check()
        output.check_space(scene, layers=10 if arguments.denoise else 0)
        output.check_layers(scene, arguments)
    lajolla.outputs.warn_of_unused(outputs, arguments)
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
    tev: Tev | None,
    shown: Sequence[Observer],
    written: list[str],
) -> int:
    """Renders, and saves what there is at the end, after an interrupt, or after an error.

    The names of the pictures that were written are added to `written`, also if something else fails.
    """
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
                            threads=arguments.threads, progress=patience.stopping(observe)
                        )
                with displayed() as observe:
                    rendering.run(patience.stopping(_saving(saver, _together(observe, *shown))))
        except Exception as error:  # whatever it is, the samples so far are saved
            failure = error
        problem = failure or patience.interrupt
        if rendering.samples == 0 and problem is not None:
            raise problem
        if patience.interrupt is not None and not arguments.keep_partial:
            if saver is not None:
                patience.save(saver.write)
            raise patience.interrupt
        names, failures = patience.save(_save, outputs, scene, rendering, features, arguments, saver, tev)
    written += names
    if failure is not None:
        failures.append(failure)
    told = f"wrote {', '.join(written)} ({_summary(scene, rendering)})" if written else "nothing was written"
    with handled_by(partial(end_at_once, message="; ".join([told, *map(str, failures)]))):
        if patience.interrupt is not None and failure is None:
            say(f"interrupted; {told}")
        elif written and (failures or not arguments.quiet):
            say(told)
        if tev is not None:
            tev.close()
    lajolla.outputs.raise_last(failures)
    return patience.interrupt.exit_code if patience.interrupt is not None else 0


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


def _together(*observers: Observer) -> Observer:
    """An observer that calls others."""

    def observe_all(progress: lajolla.Progress) -> None:
        for observe in observers:
            observe(progress)

    return observe_all


def _show_in_tev(tev: Tev, name: str, rendering: lajolla.Rendering, progress: lajolla.Progress) -> None:
    if progress.samples > 0:
        tev.offer(name, lambda: lajolla.tev.channels_of(rendering.mean()))


def _save(
    outputs: Sequence[lajolla.outputs.Output],
    scene: lajolla.Scene,
    rendering: lajolla.Rendering,
    features: Mapping[str, FloatImage] | None,
    arguments: argparse.Namespace,
    saver: lajolla.checkpoint.Saver | None,
    tev: Tev | None,
) -> tuple[list[str], list[Exception]]:
    """Writes all outputs of a render, denoised if there are features.

    Returns the names of the pictures that were written, and what went wrong.
    """
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
    if tev is not None:
        tev.offer(str(outputs[0]), lambda: lajolla.tev.channels_of(picture))
    written, errors = lajolla.outputs.write_pictures(outputs, picture, arguments)
    failures += errors
    _report_nonfinite(rendering, arguments)
    if arguments.stats is not None:
        try:
            stats = lajolla.outputs.statistics(scene, rendering)
            lajolla.outputs.write_statistics(arguments.stats, stats)
        except (OSError, lajolla.ImageError) as problem:
            failures.append(problem)
    return written, failures


def _render_each_sensor(arguments: argparse.Namespace) -> int:
    """Renders all sensors until an interrupt; errors name the sensor."""
    names = lajolla.scene.sensor_names(scene_file(arguments), parameters=dict(arguments.parameters))
    renders = lajolla.series.for_each_sensor(arguments, names)
    if len(renders) == 1:
        return command_render(renders[0].arguments)
    return _render_each(renders, keep_going=True)


def _render_each_frame(arguments: argparse.Namespace) -> int:
    """Renders all frames until an interrupt, or an error without --keep-going."""
    scene_file(arguments)  # standard input can be read only once
    renders = lajolla.series.for_each_frame(arguments)
    if len(renders) > 1 and all(one.arguments.parameters == arguments.parameters for one in renders):
        say("warning: all frames are equal, because no -D has a {frame} or a range FROM..TO")
    return _render_each(renders, keep_going=arguments.keep_going)


def command_batch(arguments: argparse.Namespace) -> int:
    """Renders the jobs of a file until an interrupt, or an error without --keep-going."""
    passed_on = [
        *(["--quiet"] if arguments.quiet else []),
        *(["--skip-existing"] if arguments.skip_existing else []),
        *([f"--threads={arguments.threads}"] if arguments.threads else []),
    ]
    renders = []
    for name, words in lajolla.series.jobs_of(arguments.jobs):
        if arguments.dry_run:
            print(shlex.join(["lajolla", "render", *words]))
            continue
        try:
            job = parse(["render", *words, *passed_on])
        except UsageError as problem:
            raise UsageError(f"{arguments.jobs}: {name}: {problem}") from None
        if not job.scene.exists() and not arguments.keep_going:  # before hours of other jobs
            raise UsageError(f"{arguments.jobs}: {name}: {job.scene}: no such file")
        job.keep_partial = False
        renders.append(lajolla.series.Render(name, job))
    if not renders:
        return 0
    return _render_each(lajolla.series.all_frames(renders), keep_going=arguments.keep_going)


@dataclass
class Previous:
    """The last scene of a series, which the next one may share files with."""

    scene: lajolla.Scene | None = None


def _render_each(renders: Sequence[Render], *, keep_going: bool) -> int:
    """Renders all of a series until an interrupt, or an error; the messages name the render."""
    lajolla.series.check_distinct(renders)
    for render in renders:
        lajolla.outputs.check(render.arguments)
    previous = renders[0].arguments.previous or Previous()
    result = 0
    for render in renders:
        render.arguments.previous = previous
        missing = f"nothing was written of {render.name} and those after it"
        code = reported(partial(explained, command_render, render.arguments), missing)
        if code > 1:  # an interrupt's
            return code
        if code == 1:
            say(f"{render.name} failed")
            result = 1
            if not keep_going:
                break
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
    for path, count in Counter(arguments.files).items():
        if count > 1:
            raise UsageError(f"{path} is named twice")
    files = {path: lajolla.checkpoint.read(path) for path in arguments.files}
    result = lajolla.checkpoint.merged(files)
    if result.left_out:
        say(f"warning: {', '.join(result.left_out)} left out, which only a render of the scene can compute")
    lajolla.outputs.warn_of_unused(outputs, arguments)
    written, failures = lajolla.outputs.write_pictures(outputs, result.image(), arguments)
    if arguments.checkpoint is not None:
        try:
            result.write(arguments.checkpoint)
            written.append(str(arguments.checkpoint))
        except lajolla.ImageError as problem:
            failures.append(problem)
    if written:
        say(f"wrote {', '.join(written)} ({int(result.counts.max())} samples per pixel)")
    lajolla.outputs.raise_last(failures)
    return 0
