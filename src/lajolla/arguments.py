"""Command line options: names, values and error messages."""

import argparse
import difflib
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from lajolla import option_values
from lajolla.aovs import AOVS
from lajolla.help_texts import EXAMPLES, GENERAL
from lajolla.limits import COMPRESSIONS, FOOTPRINTS, STRATEGIES
from lajolla.messages import suggestion

STREAMS = {"-": "stdout", "/dev/stdout": "stdout", "/dev/stderr": "stderr"}
ENDINGS = ".exr, .hdr, .pfm, .png, .jpg, .tif, .webp, .npy, .npz, .m"


class UsageError(Exception):
    """An invalid command line; the message states why."""


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are exceptions, and which suggests the nearest option."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401
        super().__init__(allow_abbrev=False, **settings)

    def print_help(self, file: Any = None) -> None:  # noqa: ANN401
        print(self.format_help(), end="", file=file)  # the original hides what goes wrong

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}\n(see {self.prog} --help)")

    def refuse_unknown(self, words: Sequence[str]) -> NoReturn:
        options = [option for action in self._actions for option in action.option_strings]
        near = difflib.get_close_matches(words[0].partition("=")[0], options, n=1)
        kind = "option" if words[0].startswith("-") else "argument"
        self.error(f"unknown {kind} {words[0]!r}" + (f"; did you mean {near[0]}?" if near else ""))


class Version(argparse.Action):
    """Prints the version and the core's instruction set, and ends the program."""

    def __call__(self, parser: argparse.ArgumentParser, *rest: object) -> NoReturn:
        from importlib.metadata import version  # takes as long as all else that --help needs

        from lajolla import _core

        print(f"lajolla {version('lajolla')} ({_core.isa})")
        parser.exit()


def parse(words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line without its first word. Raises UsageError; --help raises SystemExit."""
    parser, commands = build_parser()
    if words and not words[0].startswith("-") and words[0] not in commands:
        _refuse_command(words[0], list(commands))
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        commands.get(arguments.command, parser).refuse_unknown(unknown)
    if arguments.command is None:
        parser.error("a command is required: " + ", ".join(commands))
    if arguments.command == "render":
        _check_render(arguments, commands["render"])
    if arguments.command == "merge" and not arguments.outputs and arguments.checkpoint is None:
        commands["merge"].error("name a picture to write with -o, or a checkpoint with --checkpoint")
    if arguments.command == "compare" and str(arguments.a) == str(arguments.b) == "-":
        commands["compare"].error("standard input holds one picture, not both")
    if arguments.command == "convert" and arguments.pack and is_standard_output(arguments.target):
        commands["convert"].error("--pack writes meshes beside OUT; standard output has no room for them")
    return arguments


def _check_render(arguments: argparse.Namespace, parser: Parser) -> None:
    if arguments.sample is not None and arguments.pixel is None:
        parser.error("--sample needs --pixel")
    if arguments.all_sensors and (arguments.sensor is not None or arguments.pixel is not None):
        parser.error("--all-sensors cannot be combined with --sensor or --pixel")
    if (arguments.port or arguments.no_browser) and not arguments.view:
        parser.error("--port and --no-browser need --view")
    if arguments.view and (arguments.frames is not None or arguments.all_sensors):
        parser.error("--view shows one render; it cannot be combined with --frames or --all-sensors")
    if arguments.mixed and arguments.cluster is None:
        parser.error("--mixed needs --cluster")
    if arguments.frames is not None and arguments.pixel is not None:
        parser.error("--frames cannot be combined with --pixel")
    if arguments.keep_going and arguments.frames is None:
        parser.error("--keep-going needs --frames")
    if arguments.skip_existing and not arguments.outputs:
        parser.error("--skip-existing needs a picture: name it with -o")
    outputs = [str(path) for path in arguments.outputs or []]
    if str(arguments.scene) == "-" and not outputs and arguments.pixel is None:
        parser.error("a scene from standard input has no name for its picture: name it with -o")
    if arguments.checkpoint is None:
        arguments.checkpoint = arguments.resume
    if arguments.every is not None and arguments.checkpoint is None:
        parser.error("--every needs --checkpoint or --resume")
    if "-" in (str(arguments.checkpoint), str(arguments.resume)):
        parser.error("a checkpoint needs a file")
    if arguments.pixel is not None:
        _refuse_with_pixel(arguments, parser)
    if "-" in outputs and is_standard_output(arguments.stats):
        parser.error("the picture and --stats cannot both go to standard output")


def _refuse_with_pixel(arguments: argparse.Namespace, parser: Parser) -> None:
    for name in (
        "denoise",
        "checkpoint",
        "time",
        "noise",
        "adaptive",
        "first_sample",
        "cluster",
        "tev",
        "view",
    ):
        if getattr(arguments, name):
            parser.error(f"--{name.replace('_', '-')} cannot be combined with --pixel")


def prints_results(arguments: argparse.Namespace) -> bool:
    """Whether a result of a command goes to standard output."""
    if arguments.command in ("render", "merge"):
        named = [*(arguments.outputs or []), arguments.stats]
        return arguments.pixel is not None or any(is_standard_output(path) for path in named)
    if arguments.command == "denoise":
        return any(is_standard_output(path) for path in arguments.outputs)
    if arguments.command == "batch":
        return bool(arguments.dry_run)
    return arguments.command != "convert" or is_standard_output(arguments.target)


def is_standard_output(path: Path | None) -> bool:
    return STREAMS.get(str(path)) == "stdout"


def _refuse_command(word: str, commands: list[str]) -> NoReturn:
    if word in ("test", "docs"):
        raise UsageError(f"{word!r} belongs to a checkout of the source code: ./lajolla {word}")
    if word.lower().endswith(".xml"):
        raise UsageError(f"a command is required; did you mean: lajolla render {shlex.quote(word)}")
    raise UsageError(f"unknown command {word!r}{suggestion(word, commands)}")


def build_parser() -> tuple[Parser, dict[str, Parser]]:
    """The parser of all commands, and those of each."""
    parser = Parser(
        prog="lajolla",
        description="A physically based renderer that opens Mitsuba scenes.",
        epilog=GENERAL,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-V", "--version", action=Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    adders: dict[str, tuple[str, Callable[[Parser], None]]] = {
        "render": ("render a scene", _add_render),
        "view": ("look at a scene in the browser, and change it", _add_view),
        "batch": ("render the jobs of a file", _add_batch),
        "denoise": ("remove noise from a rendered picture", _add_denoise),
        "check": ("open a scene; print statistics and warnings", _add_check),
        "convert": ("write a scene as a file for Mitsuba 3", _add_convert),
        "compare": ("measure the difference between two pictures", _add_compare),
        "merge": ("merge checkpoints of one picture that hold different samples", _add_merge),
        "list": ("show the plugins and their parameters", _add_list),
        "completion": ("print a script that completes commands and options in a shell", _add_completion),
    }
    parsers = {}
    for name, (help_text, add) in adders.items():
        parsers[name] = commands.add_parser(
            name,
            help=help_text,
            description=help_text[0].upper() + help_text[1:] + ".",
            epilog=EXAMPLES[name],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        add(parsers[name])
    return parser, parsers


def _add_file(parser: Parser) -> argparse._ArgumentGroup:
    """Adds the scene argument and the options of the reader; returns their group."""
    parser.add_argument(
        "scene",
        type=Path,
        metavar="SCENE",
        help="Mitsuba scene file (XML); - reads standard input, with files relative to the working folder",
    )
    parser.set_defaults(standard_input=None, previous=None)
    group = parser.add_argument_group("scene")
    group.add_argument(
        "-D",
        dest="parameters",
        type=option_values.definition,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="value of the scene's parameter $NAME; repeatable",
    )
    group.add_argument("--strict", action="store_true", help="unknown plugins and properties are errors")
    return group


def _add_scene(parser: Parser) -> None:
    group = _add_file(parser)
    group.add_argument("--two-sided", action="store_true", help="opaque surfaces reflect on both sides")
    group.add_argument("--sensor", metavar="N|ID", help="sensor to render: its number, from 0, or its id")
    group = parser.add_argument_group("picture")
    group.add_argument(
        "--size",
        type=option_values.size,
        metavar="WxH",
        help="size of the film; removes the scene's crop window",
    )
    group.add_argument(
        "--crop", type=option_values.crop, metavar="X,Y,W,H", help="render only this window of the film"
    )
    group.add_argument("--spp", type=option_values.whole("spp"), metavar="N", help="samples per pixel")
    group.add_argument("--seed", type=option_values.whole("seed"), metavar="N", help="seed of the sampler")
    group.add_argument(
        "--sampler",
        choices=("sobol", "independent"),
        help="sampler to use, whichever the scene names (default: sobol, which has the least noise)",
    )
    group.add_argument(
        "--integrator",
        metavar="NAME",
        help="integrator to use instead of the scene's (lajolla list integrator)",
    )
    group.add_argument(
        "--max-depth",
        type=option_values.whole("max_depth"),
        metavar="N",
        help="longest path in segments; -1: no limit",
    )
    group.add_argument(
        "--strategy",
        choices=STRATEGIES,
        help="how direct light is found: by directions that the BSDF samples, by points that are sampled on "
        "lights, or by both, weighted by multiple importance sampling (mis, the default)",
    )
    group.add_argument(
        "--footprint",
        choices=FOOTPRINTS,
        help="how the area that a pixel covers is followed, over which textures with the filters ewa and "
        "trilinear are filtered: by ray differentials (the default), or as a cone",
    )
    group.add_argument(
        "--hide-emitters",
        action="store_const",
        const=True,
        help="lights are invisible to the camera, and alpha is 0 where there is nothing else",
    )
    group.add_argument(
        "--robust",
        action="store_const",
        const=True,
        help="let no ray pass between neighbouring triangles, which costs about a tenth of the time",
    )
    group.add_argument(
        "--aov",
        dest="aovs",
        type=option_values.aovs,
        action="extend",
        default=[],
        metavar="NAME,...",
        help=f"variables in layers of their own, in .exr and .npz files; repeatable: {', '.join(AOVS)}",
    )


def _add_render(parser: Parser) -> None:
    _add_scene(parser)
    parser.set_defaults(suffix="", keep_partial=True)
    group = _add_output(
        parser,
        default=" (default: the scene's name with the endings for its film, usually .exr and .png)",
    )
    group.add_argument(
        "--all-sensors",
        action="store_true",
        help="render one picture per sensor; its id or number is appended to file names",
    )
    group.add_argument(
        "--denoise",
        action="store_true",
        help="remove noise with Open Image Denoise (the package pyoidn); EXR files keep the "
        "noisy picture as a layer",
    )
    group = _add_series(parser)
    group.add_argument(
        "--frames",
        type=option_values.frames,
        metavar="1-240",
        help="render these frames: {frame} in a value of -D is the number, and -D NAME=FROM..TO goes from "
        "the first frame to the last; {frame:04} in OUT is the number with zeros, otherwise it is appended",
    )
    group = parser.add_argument_group(
        "end (at the first of --spp, --time and --noise; default: the scene's spp)"
    )
    group.add_argument("--time", type=option_values.seconds, metavar="90s|5m|1h", help="time for rendering")
    group.add_argument(
        "--noise",
        type=option_values.noise,
        metavar="X",
        help="relative error of the picture, as estimated from its samples: 0.01 is hardly visible",
    )
    group.add_argument(
        "--adaptive",
        action=argparse.BooleanOptionalAction,
        help="take more samples where the error is larger; --spp is then a mean (default: with --noise)",
    )
    group = parser.add_argument_group("checkpoints (docs/rendering.md)")
    group.add_argument(
        "--checkpoint", type=Path, metavar="FILE", help="file for the samples so far, written every minute"
    )
    group.add_argument(
        "--every", type=option_values.seconds, metavar="TIME", help="time between two writes (default: 60s)"
    )
    group.add_argument(
        "--resume", type=Path, metavar="FILE", help="continue this checkpoint, and keep updating it"
    )
    group.add_argument(
        "--first-sample",
        type=option_values.whole("sample"),
        default=0,
        metavar="N",
        help="number of the first sample of each pixel, to render a picture in parts for lajolla merge",
    )
    group = _add_run(parser)
    group.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="render on the workers of a Dask scheduler, tcp://HOST:8786, or in N processes of this machine, "
        "local:N; --threads is then of each worker",
    )
    group.add_argument(
        "--mixed",
        action="store_true",
        help="with --cluster: permit other instruction sets, which change the last bits of a picture",
    )
    _add_tev(group)
    group.add_argument(
        "--view",
        action="store_true",
        help="show the render in the browser while it goes on, as lajolla view does; the command ends when "
        "the picture is written, and the page keeps the last one",
    )
    _add_page(group)
    group.add_argument(
        "--stats", type=Path, metavar="FILE", help="write times and counts as JSON; - is standard output"
    )
    group.add_argument(
        "--pixel", type=option_values.pixel, metavar="X,Y", help="only print this pixel's radiance"
    )
    group.add_argument(
        "--sample", type=option_values.whole("sample"), metavar="N", help="with --pixel: only this sample"
    )


def _add_tev(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--tev",
        type=option_values.address,
        metavar="HOST:PORT",
        help="show the picture and its layers in tev while they are rendered; tev listens at localhost:14158",
    )


def _add_page(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--port",
        type=option_values.whole("port"),
        default=0,
        metavar="N",
        help="of the page (default: any free one)",
    )
    group.add_argument("--no-browser", action="store_true", help="only print the page's address")


def _add_series(parser: Parser) -> argparse._ArgumentGroup:
    """Adds the options of several renders; returns their group."""
    group = parser.add_argument_group("series (docs/rendering.md)")
    group.add_argument("--skip-existing", action="store_true", help="render only pictures that are not there")
    group.add_argument("--keep-going", action="store_true", help="go on with the next render after an error")
    return group


def _add_batch(parser: Parser) -> None:
    parser.add_argument("jobs", type=Path, metavar="JOBS", help="TOML file with options of lajolla render")
    group = _add_series(parser)
    group.add_argument(
        "--dry-run", action="store_true", help="only print the commands, with paths relative to this folder"
    )
    _add_run(parser)


def _add_view(parser: Parser) -> None:
    _add_scene(parser)
    group = parser.add_argument_group("viewer")
    group.add_argument(
        "--noise",
        type=option_values.noise,
        metavar="X",
        help="render until this relative error of the picture, as estimated",
    )
    group.add_argument("--compare", type=Path, metavar="PICTURE", help="picture to compare with in the page")
    _add_page(group)
    _add_tev(group)
    group.add_argument(
        "--threads", type=option_values.whole("threads"), metavar="N", help="number of threads (default: all)"
    )


def _add_denoise(parser: Parser) -> None:
    parser.add_argument("picture", type=Path, metavar="PICTURE", help="picture; - reads standard input")
    _add_output(parser, default="", required=True)
    _add_run(parser)


def _add_output(parser: Parser, *, default: str, required: bool = False) -> argparse._ArgumentGroup:
    """Adds the options of written pictures; returns their group."""
    group = parser.add_argument_group("output")
    group.add_argument(
        "-o",
        "--output",
        dest="outputs",
        type=Path,
        action="append",
        required=required,
        metavar="OUT",
        help=f"picture to write, {ENDINGS} and others; - is standard output; repeatable{default}",
    )
    group.add_argument(
        "--format",
        metavar="NAME",
        help="exr, png, ...: format of outputs without a known ending",
    )
    group.add_argument("--half", action="store_true", help="16-bit instead of 32-bit colours in EXR")
    group.add_argument(
        "--compression",
        choices=COMPRESSIONS,
        default="zip",
        help="of EXR (default: zip); pxr24, b44 and dwa are not exact",
    )
    group.add_argument(
        "--exposure",
        type=option_values.finite,
        default=0.0,
        metavar="STOPS",
        help="brightens PNG, JPEG and the like by 2^STOPS",
    )
    group.add_argument(
        "--tonemap",
        choices=("gamma", "reinhard"),
        help="tone mapping instead of the film's: exposure only, or Reinhard et al. 2002",
    )
    return group


def _add_run(parser: Parser) -> argparse._ArgumentGroup:
    """Adds the options of how to run; returns their group."""
    group = parser.add_argument_group("run")
    group.add_argument(
        "--threads", type=option_values.whole("threads"), metavar="N", help="number of threads (default: all)"
    )
    group.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    return group


def _add_check(parser: Parser) -> None:
    _add_scene(parser)
    group = parser.add_argument_group("report")
    group.add_argument(
        "--all", action="store_true", help="SCENE is a folder: open every scene below it and print a table"
    )
    group.add_argument("--json", action="store_true", help="print JSON (docs/json.md)")


def _add_convert(parser: Parser) -> None:
    _add_file(parser)
    parser.add_argument(
        "target",
        type=Path,
        metavar="OUT",
        help="XML file to write, of version 3.0.0; - is standard output, where names of files are "
        "relative to the working folder",
    )
    parser.add_argument(
        "--pack",
        action="store_true",
        help="copy all meshes as PLY into the folder of OUT instead of referring to those of SCENE",
    )


def _add_merge(parser: Parser) -> None:
    parser.add_argument(
        "files", type=Path, nargs="+", metavar="CHECKPOINT", help="written by lajolla render --checkpoint"
    )
    _add_output(parser, default="")
    parser.add_argument("--checkpoint", type=Path, metavar="FILE", help="also write the sum as a checkpoint")
    parser.set_defaults(stats=None, pixel=None, resume=None)


def _add_compare(parser: Parser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="picture; - reads standard input")
    parser.add_argument("b", type=Path, metavar="B", help="reference picture")
    parser.add_argument(
        "--diff", type=Path, metavar="OUT", help="write a picture: red where A is brighter, blue where darker"
    )
    parser.add_argument("--json", action="store_true", help="print JSON (docs/json.md)")


def _add_list(parser: Parser) -> None:
    parser.add_argument("kind", nargs="?", metavar="KIND", help="bsdf, emitter, shape, ...")
    parser.add_argument("name", nargs="?", metavar="NAME", help="plugin whose parameters to show")


def _add_completion(parser: Parser) -> None:
    parser.add_argument(
        "shell", choices=("bash", "zsh", "fish", "tcsh"), help="shell to generate the script for"
    )


def replay_command(arguments: argparse.Namespace, x: int, y: int, sample: int | None = None) -> str:
    """The command that repeats one sample of a pixel of this render, or all of them."""
    words = ["lajolla", "render", str(arguments.scene)]
    words += [word for name, value in arguments.parameters for word in ("-D", f"{name}={value}")]
    if arguments.size:
        words += ["--size", "x".join(map(str, arguments.size))]
    if arguments.crop:
        words += ["--crop", ",".join(map(str, arguments.crop))]
    for flag in ("seed", "sampler", "integrator", "max_depth", "strategy", "footprint", "sensor"):
        if getattr(arguments, flag) is not None:
            words += ["--" + flag.replace("_", "-"), str(getattr(arguments, flag))]
    if arguments.two_sided:
        words += ["--two-sided"]
    if arguments.hide_emitters:
        words += ["--hide-emitters"]
    if arguments.robust:
        words += ["--robust"]
    words += ["--pixel", f"{x},{y}"]
    if sample is not None:
        words += ["--sample", str(sample)]
    elif arguments.spp is not None:
        words += ["--spp", str(arguments.spp)]
    return shlex.join(words)
