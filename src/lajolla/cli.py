"""The command line: `lajolla render`, `denoise`, `check` and so on.

Results go to standard output, everything else to standard error. Every error of the user's is one message and
exit code 1; an interrupted command ends with 128 + the signal's number, as in a shell.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import lajolla  # its modules are loaded when they are first used, which no --help does
from lajolla import render_command
from lajolla.arguments import UsageError, is_standard_output, parse, prints_results
from lajolla.command_errors import explained, reported
from lajolla.display import coloured, is_closed, print_message, safe_messages, say
from lajolla.interrupts import Patience, handled_by

LEAST_MEMORY = (
    384 << 20
)  # of addresses: the libraries take most of it when they are loaded, and abort without


def main(words: Sequence[str] | None = None) -> int:
    """Runs a command line (by default that of the process) and returns the exit code."""
    with safe_messages():
        return reported(lambda: _run_command(_parsed(sys.argv[1:] if words is None else words)))


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
    _check_memory_limit()
    if prints_results(arguments) and is_closed(sys.stdout):
        raise UsageError("standard output is closed, and the result belongs there")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy would start threads that spin for nothing
    code = explained(COMMANDS[arguments.command], arguments)
    sys.stdout.flush()
    return code


def command_view(arguments: argparse.Namespace) -> int:
    from lajolla.viewer.command import view  # here, as other commands need no server

    arguments.previous = render_command.Previous()  # for files that have not changed
    return view(arguments, lambda: render_command.load(arguments))


def command_denoise(arguments: argparse.Namespace) -> int:
    lajolla.denoising.check_available()
    outputs = lajolla.outputs.outputs_of(arguments)
    for output in outputs:
        output.check()
    source = sys.stdin.buffer if str(arguments.picture) == "-" else arguments.picture
    picture = lajolla.Image.open(source)
    patience = Patience("the picture")
    lajolla.outputs.warn_of_unused(outputs, arguments)
    with handled_by(patience):
        written, failures = patience.save(_denoise, outputs, picture, arguments)
    if written and (failures or not arguments.quiet):
        say(f"wrote {', '.join(written)}")
    lajolla.outputs.raise_last(failures)
    return patience.interrupt.exit_code if patience.interrupt is not None else 0


def _denoise(
    outputs: Sequence[lajolla.outputs.Output], picture: lajolla.Image, arguments: argparse.Namespace
) -> tuple[list[str], list[Exception]]:
    denoised = picture.denoise(threads=arguments.threads)
    return lajolla.outputs.write_pictures(outputs, denoised, arguments)


def command_convert(arguments: argparse.Namespace) -> int:
    target = Path("-") if is_standard_output(arguments.target) else arguments.target
    if str(target) != "-":
        lajolla.whole_files.check_folder(target)
        if str(arguments.scene) != "-" and _same_file(target, arguments.scene):
            raise UsageError(f"{target} is the scene itself; name another file to write")
    parameters = dict(arguments.parameters)
    result = lajolla.scene.convert(
        render_command.scene_file(arguments),
        target,
        parameters=parameters,
        strict=arguments.strict,
        pack=arguments.pack,
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
        scene = render_command.load(arguments)
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
    findings = lajolla.survey.survey(arguments.scene, lambda path: render_command.load(arguments, path))
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
    "render": render_command.command_render,
    "batch": render_command.command_batch,
    "view": command_view,
    "denoise": command_denoise,
    "check": command_check,
    "convert": command_convert,
    "compare": command_compare,
    "merge": render_command.command_merge,
    "list": command_list,
    "completion": command_completion,
}
