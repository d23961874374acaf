#!/usr/bin/python3
"""The shape that every message of the API keeps to.   usage: api_shape_test.py PROTO_FOLDER

Enums begin with UNSPECIFIED, lists have pages, results carry any number of subjects, times and durations have one form
each, and every model coordinate has a name and its uncertainty."""
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from google.protobuf import descriptor_pb2

PROTO = Path(sys.argv.pop(1)).resolve()
Field = descriptor_pb2.FieldDescriptorProto
TIMESTAMP, DURATION = ".google.protobuf.Timestamp", ".google.protobuf.Duration"


def all_files():
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "set"
        names = sorted(str(file.relative_to(PROTO)) for file in PROTO.glob("kinevox/v1/*.proto"))
        subprocess.run(["protoc", f"--proto_path={PROTO}", f"--descriptor_set_out={out}", *names], check=True)
        return descriptor_pb2.FileDescriptorSet.FromString(out.read_bytes()).file


def nested(message, scope=""):
    name = f"{scope}{message.name}"
    yield name, message
    for inner in message.nested_type:
        yield from nested(inner, name + ".")


def upper_snake(name):
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).upper()


class ApiShape(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        files = all_files()
        cls.messages = dict(pair for file in files for message in file.message_type for pair in nested(message))
        cls.enums = [enum for file in files for enum in file.enum_type]
        cls.enums += [enum for message in cls.messages.values() for enum in message.enum_type]
        cls.methods = {method.name: method for file in files for service in file.service for method in service.method}

    def fields(self):
        for name, message in self.messages.items():
            for field in message.field:
                yield f"{name}.{field.name}", field

    def field(self, message, name):
        found = [field for field in self.messages[message].field if field.name == name]
        self.assertTrue(found, f"{message} has no field {name}")
        return found[0]

    def test_enums_begin_with_unspecified(self):
        self.assertGreater(len(self.enums), 15)
        for enum in self.enums:
            prefix = upper_snake(enum.name) + "_"
            self.assertEqual((enum.value[0].name, enum.value[0].number), (prefix + "UNSPECIFIED", 0), enum.name)
            for value in enum.value:
                self.assertTrue(value.name.startswith(prefix), value.name)

    def test_lists_have_pages(self):
        lists = [name for name in self.methods if name.startswith("List")]
        self.assertEqual(len(lists), 5, lists)
        for name in lists:
            self.assertEqual(self.field(name + "Request", "page_size").type, Field.TYPE_INT32)
            self.assertEqual(self.field(name + "Request", "page_token").type, Field.TYPE_STRING)
            self.assertEqual(self.field(name + "Response", "next_page_token").type, Field.TYPE_STRING)

    def test_results_status_and_body_carry_any_number_of_subjects(self):
        for message in (
            "StreamVolumesResponse",
            "StreamPosesResponse",
            "GetStatusResponse",
            "CameraStatus",
            "WatchBodyResponse",
        ):
            self.assertEqual(self.field(message, "subjects").label, Field.LABEL_REPEATED, message)
        self.assertEqual(self.field("Event", "subject_id").type, Field.TYPE_UINT32)

    def test_times_and_durations_have_one_form(self):
        for name, field in self.fields():
            # Frame data are integers in nanoseconds; a place in a recording is a number of seconds.
            if field.type_name == TIMESTAMP:
                self.assertTrue(field.name.endswith("_time"), name)
            elif field.name.endswith("_time"):
                self.fail(f"{name} is no Timestamp")
            if re.search(r"_ns$", field.name):
                self.assertTrue(field.name.endswith("_time_ns") and field.type == Field.TYPE_INT64, name)
            if re.search(r"(^|_)(seconds|timeout|duration|interval|uptime)$", field.name):
                self.assertEqual(field.type_name, DURATION, name)
            if re.search(r"(?<!_per)_s$", field.name):
                self.assertEqual(field.name, "position_s", name)

    def test_repeated_fields_are_plural_and_counts_say_so(self):
        for name, field in self.fields():
            if field.label == Field.LABEL_REPEATED:
                singular = ("distortion", "rotation_camera_from_world")  # matrices
                self.assertTrue(re.search(r"s(_deg)?$", field.name) or field.name in singular, name)
            elif field.type in (Field.TYPE_INT32, Field.TYPE_UINT32, Field.TYPE_INT64, Field.TYPE_UINT64):
                counted = r"^(frames|images|cameras|voxels|subscribers|results|poses|entries|views|packets)$"
                self.assertIsNone(re.match(counted, field.name), f"{name} is a number; call it ..._count")

    def test_all_coordinates_have_values_and_uncertainty(self):
        for message in ("CoordinateEstimate", "TranslationEstimate"):
            names = {field.name for field in self.messages[message].field}
            self.assertLessEqual({"name", "withheld_reason"}, names)
            self.assertTrue({"std_deg", "std_m"} & names and {"value_deg", "value_m"} & names, names)
        for name in ("coordinates", "translations"):
            self.assertEqual(self.field("Pose", name).label, Field.LABEL_REPEATED)


if __name__ == "__main__":
    unittest.main()
