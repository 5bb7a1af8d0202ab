"""A layout that draws nothing and checks everything that a panel asks of it against live RNA.

Blender's module has no window, but it knows the same properties, operators, icons and keywords:
a wrong name fails here as it would there.
"""

from __future__ import annotations

from typing import Any

import bpy

LAYOUT = bpy.types.UILayout.bl_rna
TYPES = {"FLOAT": (int, float), "INT": (int,), "BOOLEAN": (bool, int), "STRING": (str,)}


def check_value(rna: bpy.types.Property, value: object) -> None:
    """That Blender would take this value for this property or keyword."""
    if rna.type == "ENUM":
        known = [item.identifier for item in rna.enum_items_static or rna.enum_items]
        assert value in known, f"{rna.identifier} = {value!r}"
    elif rna.type in TYPES:
        assert isinstance(value, TYPES[rna.type]), f"{rna.identifier} = {value!r}"


class RecordedOperator:
    """What `layout.operator` returns: only the operator's own properties can be set."""

    def __init__(self, rna: bpy.types.Struct) -> None:
        object.__setattr__(self, "_rna", rna)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in self._rna.properties, f"{self._rna.identifier} has no property {name}"
        check_value(self._rna.properties[name], value)


class RecordingLayout:
    """Stands in for `bpy.types.UILayout`; `log` holds (function, arguments) of the whole panel."""

    def __init__(self, log: list[tuple[str, dict[str, Any]]] | None = None) -> None:
        object.__setattr__(self, "log", [] if log is None else log)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in LAYOUT.properties, f"UILayout has no property {name}"
        assert not LAYOUT.properties[name].is_readonly, f"UILayout.{name} is read-only"
        check_value(LAYOUT.properties[name], value)

    def __getattr__(self, name: str) -> Any:
        assert name in LAYOUT.functions, f"UILayout has no function {name}"
        function = LAYOUT.functions[name]
        inputs = [p for p in function.parameters if not p.is_output]

        def call(*given: Any, **keywords: Any) -> Any:
            assert len(given) <= len(inputs), f"{name} takes {len(inputs)} arguments"
            known = {p.identifier: p for p in inputs}
            arguments = {p.identifier: value for p, value in zip(inputs, given, strict=False)}
            for keyword, value in keywords.items():
                assert keyword in known, f"{name} has no keyword {keyword}"
                assert keyword not in arguments, f"{name} has {keyword} twice"
                arguments[keyword] = value
            missing = [
                p.identifier for p in inputs if p.is_required and p.identifier not in arguments
            ]
            assert not missing, f"{name} lacks {missing}"
            for keyword, value in arguments.items():
                check_value(known[keyword], value)
            self.log.append((name, arguments))
            return self._answer(name, arguments, function)

        return call

    def _answer(self, name: str, arguments: dict[str, Any], function: bpy.types.Function) -> Any:
        if name == "prop":
            data = arguments["data"]
            assert arguments["property"] in data.bl_rna.properties, arguments
        if name == "operator":
            kind = bpy.ops
            for part in arguments["operator"].split("."):
                kind = getattr(kind, part)
            return RecordedOperator(kind.get_rna_type())
        outputs = [p for p in function.parameters if p.is_output]
        layouts = [RecordingLayout(self.log) for p in outputs if p.type == "POINTER"]
        return tuple(layouts) if len(layouts) > 1 else layouts[0] if layouts else None

    def labels(self) -> list[str]:
        """Every text that is drawn."""
        return [a["text"] for _, a in self.log if a.get("text")]

    def properties(self) -> list[str]:
        """Every property that is drawn."""
        return [a["property"] for name, a in self.log if name == "prop"]

    def operators(self) -> list[str]:
        """Every operator that has a button."""
        return [a["operator"] for name, a in self.log if name == "operator"]
