"""Another program's window with a file in it, to be dragged from there to Blender's:

    python3 file_manager.py FILE X Y

Run by the system's own Python, whose Tk offers the file by XDND, the protocol of X desktops.
"""

from __future__ import annotations

import sys
import tkinter
from pathlib import Path

file, x, y = sys.argv[1:]
window = tkinter.Tk()
window.title("Files")
window.geometry(f"+{x}+{y}")
label = tkinter.Label(window, text=Path(file).name, padx=24, pady=16, background="white")
label.pack()
tk = window.tk
tk.call("package", "require", "tkdnd")
tk.call("tkdnd::drag_source", "register", label, "DND_Files")
# Asked when the drag begins: what may be done with what, and the files.
tk.call("bind", label, "<<DragInitCmd>>", tk.call("list", "list", "copy", "DND_Files", [file]))
window.mainloop()
