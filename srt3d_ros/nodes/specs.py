"""The specs of all nodes, by name. Importing it imports every node and what it needs."""

from srt3d_ros.nodes import bag_recorder, player, reconstructor, recorder, sketcher

SPECS = {spec.name: spec for spec in (
    sketcher.SPEC, reconstructor.SPEC, recorder.SPEC, bag_recorder.SPEC, player.SPEC)}
