"""A second reader of what forcectl gives Foxglove, for tests/foxglove.rs: none of ours and not the app.

    foxglove_reader.py recording RUN.MCAP LAYOUT.JSON
    foxglove_reader.py live URL LAYOUT.JSON

`recording` reads the file with the public mcap package, `live` speaks Foxglove's WebSocket protocol. Each message is compared with
the JSON schema of its channel. Then every plotted path of the layout is looked up in the schemas that were seen. Prints one line of
JSON: messages of each topic, and the paths of the layout whose topic was seen.
"""
import asyncio
import json
import re
import struct
import sys

import jsonschema

PROTOCOLS = ["foxglove.sdk.v1", "foxglove.websocket.v1"]
# Opcode of a message, number of the subscription, time.
MESSAGE = struct.Struct("<BIQ")


def validator(schema):
    """For all messages of a topic: to check the schema itself with each of thousands takes minutes."""
    kind = jsonschema.validators.validator_for(schema)
    kind.check_schema(schema)
    return kind(schema)


def recording(path):
    from mcap.reader import make_reader

    counts, schemas, validators = {}, {}, {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert channel.message_encoding == "json", channel
            assert schema.encoding == "jsonschema", schema
            if channel.topic not in schemas:
                schemas[channel.topic] = json.loads(schema.data)
                validators[channel.topic] = validator(schemas[channel.topic])
            validators[channel.topic].validate(json.loads(message.data))
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    return counts, schemas


async def live(url):
    import websockets

    counts, schemas, validators, topics = {}, {}, {}, {}
    async with websockets.connect(url, subprotocols=PROTOCOLS) as socket:
        while not enough(counts):
            frame = await asyncio.wait_for(socket.recv(), 60)
            if isinstance(frame, str):
                for channel in json.loads(frame).get("channels", []):
                    assert channel["encoding"] == "json", channel
                    topics[channel["id"]] = channel["topic"]
                    schemas[channel["topic"]] = json.loads(channel["schema"])
                    validators[channel["topic"]] = validator(schemas[channel["topic"]])
                    subscription = {"id": channel["id"], "channelId": channel["id"]}
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
                continue
            opcode, subscription, _ = MESSAGE.unpack_from(frame)
            if opcode == 1:
                topic = topics[subscription]
                validators[topic].validate(json.loads(frame[MESSAGE.size :]))
                counts[topic] = counts.get(topic, 0) + 1
    return counts, schemas


def enough(counts):
    """Some of each topic that comes by itself."""
    return all(counts.get(topic, 0) >= 10 for topic in ("/unit1", "/unit6", "/rig", "/tip", "/tf", "/force"))


def paths_of(layout):
    """Every path that a panel of the layout plots."""
    if isinstance(layout, dict):
        for key, value in layout.items():
            if key == "value" and isinstance(value, str) and value.startswith("/"):
                yield value
            else:
                yield from paths_of(value)
    elif isinstance(layout, list):
        for value in layout:
            yield from paths_of(value)


def look_up(path, schemas):
    """True where the path's topic was seen and its field is a number; an error where the field is none."""
    topic, filters, fields = re.fullmatch(r"(/[\w/]+)((?:\{[^}]*\})*)(.*)", path).groups()
    if topic not in schemas:
        return False
    for name in re.findall(r"\{(\w+)==", filters):
        assert name in schemas[topic]["properties"], f"{path}: no field {name}"
    schema = schemas[topic]
    for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", fields):
        if name:
            assert name in schema.get("properties", {}), f"{path}: no field {name}"
            schema = schema["properties"][name]
        else:
            assert int(index) < schema.get("maxItems", 1 << 30), f"{path}: no element {index}"
            schema = schema["items"]
    assert schema["type"] in ("number", "integer"), f"{path} is a {schema['type']}"
    return True


def main():
    kind, source, layout = sys.argv[1:]
    counts, schemas = recording(source) if kind == "recording" else asyncio.run(live(source))
    with open(layout) as file:
        paths = list(paths_of(json.load(file)))
    assert paths, "the layout plots nothing"
    seen = [path for path in paths if look_up(path, schemas)]
    print(json.dumps({"counts": counts, "paths": seen}))


main()
