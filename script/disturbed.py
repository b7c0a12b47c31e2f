"""What script/poses-back, script/lenses-back, script/boxes-back and script/moved-actors share."""
import os, subprocess, sys

CLOAM = os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "build", "release", "bin", "cloam")


def parsed(arguments):
    """What the parser makes of the words, and those behind "--", which are options of cloam train."""
    words = sys.argv[1:]
    at = words.index("--") if "--" in words else len(words)
    return arguments.parse_args(words[:at]), words[at + 1:]


def link_files(folder, out):
    """Links every file below `folder`, also behind linked folders, into `out`: by their names below `folder`."""
    for path, _, files in os.walk(folder, followlinks=True):
        for name in files:
            to = os.path.join(out, os.path.relpath(os.path.join(path, name), folder))
            os.makedirs(os.path.dirname(to), exist_ok=True)
            os.symlink(os.path.abspath(os.path.join(path, name)), to)


def replace_link(path):
    """The place of a linked file, for another."""
    os.remove(path)
    return path


def learn(method, data, out, words):
    """Trains on `data` in OUT/run. Returns the folder of what the run learned of the data."""
    run, refined = os.path.join(out, "run"), os.path.join(out, "refined")
    subprocess.run([CLOAM, "train", method, data, "-o", run, "--pictures", "off", "-q"] + words, check=True)
    subprocess.run([CLOAM, "export", run, "--format", "capture", "-o", refined, "-q"], check=True)
    return refined
