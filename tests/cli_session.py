"""`python cli_session.py CALLS.json RESULTS.json`: many command lines in one Blender, one by one.

CALLS is a list of argument lists; RESULTS gets [status, stdout, stderr] of each, as the process's
own file descriptors saw them, so that what Blender prints by itself counts too.
"""

import json
import os
import sys
import tempfile
from pathlib import Path

from volillum_addon.blender.cli import main


def captured(arguments: list[str]) -> tuple[int, str, str]:
    kept = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        try:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            status = main(arguments)
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            for number, copy in enumerate(kept, start=1):
                os.dup2(copy, number)
                os.close(copy)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode())
    return status, texts[0], texts[1]


calls, results = (Path(name) for name in sys.argv[1:])
results.write_text(json.dumps([captured(call) for call in json.loads(calls.read_text())]))
