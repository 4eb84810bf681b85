"""What the closed-loop programs share: command line options and folders."""
import contextlib
import pathlib
import shutil
import tempfile

BUILT = pathlib.Path(__file__).resolve().parents[3] / "build" / "bin"


def add_words(parser, width, nadird="nadird"):
    """--width, --inputs, --out, --nadir and --nadird."""
    parser.add_argument("--width", type=int, default=width, help="of the frames")
    parser.add_argument("--inputs", help="existing folder with world, package and the rest")
    parser.add_argument("--out", help="folder for inputs, logs and results; default: temporary")
    parser.add_argument("--nadir", default=BUILT / "nadir")
    parser.add_argument("--nadird", default=BUILT / nadird)


def fresh(folder):
    """The folder, made and empty."""
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    return folder


@contextlib.contextmanager
def output(args, name):
    """The folder that --out names; without, one that is gone afterwards."""
    out = pathlib.Path(args.out or tempfile.mkdtemp(prefix=f"nadir-{name}."))
    try:
        yield out
    finally:
        if args.out is None:
            shutil.rmtree(out, ignore_errors=True)


def inputs_folder(args, out):
    return args.inputs or out / "inputs"
