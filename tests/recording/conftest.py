"""What a recording has, as rerun reads it."""

from rerun.chunk import RrdReader


def logged(path, entity, component):
    """The values of a component that were logged at an entity path."""
    batches = [chunk.to_record_batch() for chunk in RrdReader(path).stream().filter(content=entity)]
    return [value for batch in batches if component in batch.schema.names
            for value in batch.column(component).to_pylist()]
