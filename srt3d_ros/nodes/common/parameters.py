"""Parameters of a node, declared and checked from one table."""

import difflib
from array import array
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from srt3d_ros.core.keys import Key
from srt3d_ros.errors import InvalidInput, quoted, require
from srt3d_ros.processes.node_command import OF_EVERY_NODE

Value = bool | int | float | str
Values = dict[str, Any]         # of a node's parameters, checked, by name
KINDS = {bool: "true or false", int: "an integer", float: "a number", str: "text"}


@dataclass(frozen=True)
class Parameter:
    """One line of a node's table.

    Args:
        default: its type is the parameter's type.
        low, high: range of a number, both ends allowed; None: no limit.
        choices: all allowed values of a text.
        form: description of an allowed text.
        live: may be changed while the node runs.
        inactive: may be changed while the node is not active; the node checks it.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    form: str = ""
    live: bool = False
    inactive: bool = False

    @classmethod
    def of(cls, key: Key, **changes: Any) -> "Parameter":
        """The parameter of an option that the library has, too; it may be changed while the node runs."""
        low, high = key.bounds or (None, None)
        own = {"description": f"{key.about[0].upper()}{key.about[1:]}.", "low": low, "high": high,
               "choices": key.choices, "form": key.form, "live": True}
        return cls(key.name, key.default, **own | changes)

    @property
    def expected(self) -> str:
        """The accepted values, in words."""
        if self.choices:
            return " or ".join(self.choices)
        words = self.form or KINDS[type(self.default)]
        if self.low is not None and self.high is not None:
            words += f" from {_plain(self.low)} to {_plain(self.high)}"
        elif self.low is not None:
            words += f" of {_plain(self.low)} or more"
        return f"{words} {self.unit}".rstrip()

    @property
    def when(self) -> str:
        """When it may be changed after the start: "live", "inactive" or ""."""
        return "live" * self.live or "inactive" * self.inactive

    def check(self, value: Any) -> Any:
        """The value in the parameter's type, or InvalidInput.

        YAML reads the text off as false, which is accepted where off is, and texts of numbers as numbers or lists of
        them. For a number, an integer or a text is accepted: `ros2 param set` sends 5 as an integer and 1e-4 as a text.
        """
        kind = type(self.default)
        if kind is str and value is False and "off" in self.expected:
            value = "off"
        elif kind is str and isinstance(value, (array, list, tuple)):
            value = ",".join(map(str, value))
        if (kind is float and type(value) in (int, str)) or (kind is str and type(value) in (int, float)):
            with suppress(ValueError):
                value = kind(value)
        require(type(value) is kind, self.name, quoted(value), self.expected)
        if kind in (int, float):
            inside = (self.low is None or value >= self.low) and (self.high is None or value <= self.high)
            require(inside, self.name, value, self.expected)
        require(not self.choices or value in self.choices, self.name, value, self.expected)
        return value

    def descriptor(self) -> ParameterDescriptor:
        """The description that `ros2 param describe` shows and from which tools make sliders."""
        unit = f" [{self.unit}]" if self.unit else ""
        out = ParameterDescriptor(description=self.description + unit, read_only=not (self.live or self.inactive),
                                  additional_constraints=self.expected, dynamic_typing=True)
        if self.low is not None and self.high is not None:
            if type(self.default) is int:
                out.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high), step=0)]
            else:
                out.floating_point_range = [FloatingPointRange(from_value=float(self.low), to_value=float(self.high))]
        return out


class Parameters:
    """The parameters of a running node; `parameters["name"]` is the current, checked value.

    All functions are called in the executor's thread.

    Args:
        node: made with `automatically_declare_parameters_from_overrides=True`, which reveals unknown parameters.
        table: all parameters.
        check: called with the new values before a change; if it raises, `ros2 param set` shows the reason.
        changed: called after the change.
        failed: called with any exception of `check` but InvalidInput.

    Raises:
        InvalidInput: a value given at the start cannot be used.
    """

    def __init__(self, node: Node, table: Iterable[Parameter], check: Callable[[Values], None],
                 changed: Callable[[], None], failed: Callable[[Exception], None]):
        self._table = {parameter.name: parameter for parameter in table}
        self._values: Values = {}
        self._check_all, self._changed, self._failed = check, changed, failed
        self._warn_of_unknown(node, list(self._table))
        for name, parameter in self._table.items():
            value = parameter.default
            if node.has_parameter(name):
                value = parameter.check(node.get_parameter(name).value)
                node.undeclare_parameter(name)      # the override has declared it without type or range
            node.declare_parameter(name, value, parameter.descriptor(), ignore_override=True)
            self._values[name] = value
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def as_dict(self) -> Values:
        return dict(self._values)

    def changed(self) -> list[str]:
        """The names of those that differ from their defaults."""
        return [name for name, each in self._table.items() if self._values[name] != each.default]

    @staticmethod
    def _warn_of_unknown(node: Node, known: list[str]) -> None:
        for name in node.list_parameters([], 0).names:
            if name in known or name.startswith(OF_EVERY_NODE):
                continue
            near = difflib.get_close_matches(name, known, n=1)
            node.get_logger().warning(f"parameter {name} is ignored: {node.get_name()} has no such parameter"
                                      + (f", did you mean {near[0]}?" if near else ""))

    def _check(self, changes: list[RosParameter]) -> SetParametersResult:
        try:
            if known := self._known(changes):
                self._check_all(self._values | known)
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:      # a bug of the node: still answer the request
            self._failed(error)
            return SetParametersResult(successful=False, reason=f"internal failure, see the node's log: {error!r}")
        return SetParametersResult(successful=True)

    def _known(self, changes: list[RosParameter]) -> Values:
        """The changes to parameters of the table, checked; the node also has parameters of rclpy."""
        return {change.name: self._table[change.name].check(change.value) for change in changes
                if change.name in self._table}

    def _apply(self, changes: list[RosParameter]) -> None:
        if known := self._known(changes):
            self._values = self._values | known
            self._changed()


def _plain(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:g}"
