"""The policy for SROS 2 (DDS security): which node may use which topics and services, from the nodes' specs.

`ros2 security` makes the signed permissions of each enclave from it: docs/security.md.
"""

from collections.abc import Iterable

from srt3d_ros.nodes.node_spec import NodeSpec

# What rclpy gives to every managed node, under the node's own name.
LIFECYCLE = ("change_state", "get_state", "get_available_states", "get_available_transitions", "get_transition_graph")
READ_PARAMETERS = ("get_parameters", "list_parameters")
PARAMETERS = ("describe_parameters", "get_parameter_types", *READ_PARAMETERS, "set_parameters",
              "set_parameters_atomically")
SERVED = (*LIFECYCLE, *PARAMETERS, "get_type_description")
PUBLISHED = ("/diagnostics", "/rosout", "/parameter_events", "~/transition_event")
SUBSCRIBED = ("/clock", "/parameter_events")
WATCHES_OTHERS = "recorder"     # asks the others for their parameters
EVERYONE, OPERATOR = "all", "operator"


def policy(specs: Iterable[NodeSpec]) -> str:
    """The policy as XML: enclaves /srt3d/NAME for each node, for all nodes of `srt3d up` and for an operator.

    The operator, somebody who types `ros2 …`, may hear everything and use all services; nobody else may set a
    parameter, change a state or call a service.
    """
    specs = list(specs)
    enclaves = [(spec.name, [_profile(spec, specs)]) for spec in specs]
    enclaves.append((EVERYONE, [_profile(spec, specs) for spec in specs]))
    enclaves.append((OPERATOR, [_operator(specs)]))
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             "<!-- Made by python -m tools.generate_docs; docs/security.md says how it is used. -->",
             '<policy version="0.2.0">', "  <enclaves>"]
    for name, profiles in enclaves:
        rules = [f"        {line}" for profile in profiles for line in profile]
        lines += [f'    <enclave path="/srt3d/{name}">', "      <profiles>", *rules, "      </profiles>",
                  "    </enclave>"]
    return "\n".join([*lines, "  </enclaves>", "</policy>"]) + "\n"


def _profile(spec: NodeSpec, specs: list[NodeSpec]) -> list[str]:
    """What one node may do."""
    asked = [f"{other.name}/{service}" for other in specs for service in READ_PARAMETERS
             if spec.name == WATCHES_OTHERS]
    return _in_profile(spec.name, [
        *_rules("topic", "subscribe", [*(topic.name for topic in spec.inputs), *SUBSCRIBED]),
        *_rules("topic", "publish", [*(topic.name for topic in spec.outputs), *PUBLISHED]),
        *_rules("service", "reply", [f"~/{service}" for service in _services(spec)]),
        *_rules("service", "request", asked)])


def _operator(specs: list[NodeSpec]) -> list[str]:
    """What the command line may do: hear all topics, use all services."""
    heard = [topic.name for spec in specs for topic in (*spec.inputs, *spec.outputs)]
    events = [f"{spec.name}/transition_event" for spec in specs]
    return _in_profile("*", [
        *_rules("topic", "subscribe", [*heard, *events, *SUBSCRIBED, "/diagnostics", "/rosout"]),
        *_rules("topic", "publish", ["/rosout", "/parameter_events"]),
        *_rules("service", "reply", [f"*/{service}" for service in (*PARAMETERS, "get_type_description")]),
        *_rules("service", "request",
                [f"{spec.name}/{service}" for spec in specs for service in _services(spec)])])


def _services(spec: NodeSpec) -> list[str]:
    return [*SERVED, *spec.services]


def _in_profile(node: str, rules: list[str]) -> list[str]:
    return [f'<profile ns="/" node="{node}">', *(f"  {rule}" for rule in rules), "</profile>"]


def _rules(kind: str, verb: str, names: Iterable[str]) -> list[str]:
    names = sorted(set(names))
    if not names:
        return []
    return [f'<{kind}s {verb}="ALLOW">', *(f"  <{kind}>{name}</{kind}>" for name in names), f"</{kind}s>"]
