"""What `--help` prints after the options."""

GENERAL = """\
examples:
  lajolla render scene.xml                  writes scene.exr and scene.png
  lajolla check scene.xml                   statistics and warnings, without rendering
  lajolla render --help                     the options of a command

Errors end with exit code 1, interrupts with 130. Messages on a terminal are coloured, unless NO_COLOR is set;
FORCE_COLOR colours them everywhere. In a checkout of the source code, './lajolla test [PYTEST OPTIONS]' runs
the tests, and './lajolla docs [FOLDER]' builds the documentation as a site."""

EXAMPLES = {
    "render": """\
examples:
  lajolla render scene.xml --spp 64 --size 640x480 -o small.png
  lajolla render scene.xml -o picture.exr -o picture.jpg --exposure 1
  lajolla render scene.xml --aov albedo,normal,crypto_material -o layers.exr
  lajolla render scene.xml --pixel 10,20              the radiance of one pixel
  lajolla render scene.xml --spp 16 --denoise
  lajolla render - -o - --format png < scene.xml > picture.png
  lajolla render scene.xml --noise 1% --time 2h --checkpoint scene.ckpt
  lajolla render scene.xml --noise 1% --time 2h --resume scene.ckpt       after a crash
  lajolla render scene.xml --frames 1-240 -D angle=0..358.5 -o '{frame:04}.png'
  lajolla render scene.xml --view                     watch it in the browser until the picture is written

Ctrl-C stops rendering and saves the samples so far, denoised with --denoise.""",
    "view": """\
examples:
  lajolla view scene.xml
  lajolla view scene.xml --size 640x480 --spp 256
  lajolla view scene.xml --no-browser --port 8000     prints the address to open

The address is of this machine alone and has a random token. A change of a file of the scene is shown at once.
Ctrl-C ends it. docs/viewer.md describes the page.""",
    "batch": """\
JOBS is a TOML file with "scene" and long options of lajolla render; those above the first [[job]] belong to
all jobs. Parameters with several values are rendered in all combinations. Paths are relative to JOBS.

  spp = 64
  denoise = true

  [[job]]
  scene = "turntable.xml"
  frames = "1-240"
  parameters = {angle = "0..358.5"}
  output = "turntable-{frame:04}.exr"

  [[job]]
  scene = "balls.xml"
  parameters = {metal = ["Au", "Cu"], roughness = [0.1, 0.2, 0.4]}
  output = ["balls-{metal}-{roughness}.exr", "balls-{metal}-{roughness}.png"]

examples:
  lajolla batch jobs.toml --dry-run         the commands, without rendering
  lajolla batch jobs.toml --skip-existing   what is missing, after an interrupt""",
    "denoise": """\
examples:
  lajolla denoise noisy.exr -o clean.exr
  lajolla denoise noisy.exr -o clean.png --exposure 1

Layers albedo.R, ... and normal.x, ... of the picture help to keep details. 'lajolla render --denoise' renders
better ones.""",
    "check": """\
examples:
  lajolla check scene.xml
  lajolla check --all folder                every scene below a folder
  lajolla check scene.xml --json            for programs""",
    "convert": """\
examples:
  lajolla convert old.xml new.xml           meshes and textures stay where they are
  lajolla convert old.xml new.xml --pack    meshes are copied beside new.xml
  lajolla convert - - < old.xml > new.xml""",
    "compare": """\
examples:
  lajolla compare noisy.exr reference.exr --diff difference.png
  lajolla compare noisy.exr reference.exr --json

Prints for red, green and blue: the ratio of the means, the root of the mean squared error (RMSE), and the
relative MSE, which is the mean of (A - B)^2 / (B^2 + 0.01).""",
    "merge": """\
examples:
  lajolla render scene.xml --spp 512 --checkpoint a.ckpt
  lajolla render scene.xml --spp 512 --first-sample 512 --checkpoint b.ckpt     on a similar machine
  lajolla merge a.ckpt b.ckpt -o scene.exr                1024 samples per pixel""",
    "list": """\
examples:
  lajolla list                              every plugin by its kind
  lajolla list bsdf                         all plugins of a kind
  lajolla list bsdf roughconductor          parameters, ranges, defaults, units""",
    "completion": """\
examples:
  lajolla completion bash > ~/.local/share/bash-completion/completions/lajolla
  lajolla completion zsh > ~/.zfunc/_lajolla          a folder in $fpath
  lajolla completion fish > ~/.config/fish/completions/lajolla.fish""",
}
