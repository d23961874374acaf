#!/usr/bin/python3
"""The Python package: installation by pip without a network, type check, encrypted connection.
usage: python_package_test.py BUILD_FOLDER"""
import shutil
import subprocess
import sys
import tempfile
import unittest
from concurrent import futures
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path.insert(0, str(BUILD / "client/python"))
import grpc  # noqa: E402
import numpy as np  # noqa: E402

import kinevox  # noqa: E402
from kinevox.errors import from_status  # noqa: E402
from kinevox.v1 import capture_service_pb2 as capture_pb  # noqa: E402


def run(*command, **options):
    ran = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    if ran.returncode != 0:
        raise AssertionError(f"{' '.join(map(str, command))}\n{ran.stdout}{ran.stderr}")
    return ran.stdout


class Package(unittest.TestCase):
    def test_pip_installs_it_without_a_network(self):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            # In a copy, so that the source tree stays clean.
            for part in ("client/python", "proto"):
                shutil.copytree(REPOSITORY / part, folder / part, ignore=shutil.ignore_patterns("build", "*.egg-info"))
            run("/usr/bin/python3", "-m", "venv", "--system-site-packages", folder / "venv")
            python = folder / "venv/bin/python"
            run(
                python,
                "-m",
                "pip",
                "install",
                "--no-build-isolation",
                "--no-index",
                "--quiet",
                folder / "client/python",
            )
            program = (
                "import kinevox, kinevox.v1.types_pb2 as t; from pathlib import Path; "
                "print(kinevox.__file__, (Path(kinevox.__file__).parent / 'py.typed').exists(), t.Vec3(x=2).x)"
            )
            where, typed, value = run(python, "-c", program, cwd="/").split()
            self.assertTrue(where.startswith(str(folder / "venv")), where)
            self.assertEqual((typed, value), ("True", "2.0"))

    def test_types_are_clean(self):
        if shutil.which("mypy") is None:
            self.skipTest("mypy is not installed")
        # With a program that uses the package, whose types are revealed.
        with tempfile.NamedTemporaryFile("w", suffix=".py") as program:
            program.write(
                "from kinevox import AsyncClient, Client\n"
                "reveal_type(next(Client('').poses()).coordinates['knee_angle_r'])\n"
                "reveal_type(Client('').recordings.stop())\n"
                "async def use() -> None:\n    reveal_type(await AsyncClient('').recordings.start('x'))\n"
            )
            program.flush()
            output = run(
                "mypy",
                "--config-file",
                REPOSITORY / "client/python/pyproject.toml",
                "--cache-dir",
                BUILD / "client/python/mypy_cache",
                "kinevox",
                program.name,
                cwd=BUILD / "client/python",
            )
        self.assertIn("no issues found", output)
        for kind in ('"builtins.float"', '"kinevox.recordings.Recording"', '"builtins.str"'):
            self.assertIn(f"Revealed type is {kind}", output)

    def test_functions_have_docstrings(self):
        import ast

        bare = []
        for file in (REPOSITORY / "client/python/kinevox").glob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                kind = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
                if kind and not node.name.startswith("_") and not ast.get_docstring(node):
                    bare.append(f"{file.name}:{node.lineno} {node.name}")
        self.assertEqual([line for line in bare if not line.endswith((" run", " stop", " call"))], [])

    def test_wrong_options(self):
        for options, words in (({"server": "somewhere"}, "give HOST:PORT"), ({"timeout_s": 0}, "more than 0")):
            with self.assertRaisesRegex(kinevox.InvalidArgument, words):
                kinevox.Client(**{"server": "127.0.0.1:1", **options})
        for options, words in (
            ({"server": 5}, "server is 5, of type int; give a string"),
            ({"timeout_s": "5"}, "timeout_s is '5'; give a number of seconds"),
        ):
            with self.assertRaisesRegex(TypeError, words):
                kinevox.Client(**options)
        with self.assertRaisesRegex(TypeError, "server is 5, of type int"):
            kinevox.Client(5)

    def test_who_cancelled_a_call(self):
        def error(details):
            return from_status(grpc.StatusCode.CANCELLED, details, "here:1")

        self.assertIsInstance(error("Locally cancelled by application!"), kinevox.Cancelled)
        self.assertIsInstance(error("Channel closed!"), kinevox.Cancelled)
        stopping = error("CANCELLED")  # gRPC's status of a call to a daemon that is stopping
        self.assertIsInstance(stopping, kinevox.Unavailable)
        self.assertEqual(stopping.code, "UNAVAILABLE")
        self.assertEqual(
            str(stopping), "the daemon at here:1 ended the call because it is stopping; connect again later"
        )

    def test_damaged_volumes(self):
        for data in (b"", b"KVXV", b"x" * 200, bytes(56)):
            with self.assertRaisesRegex(kinevox.InvalidArgument, "^volume: .*damaged or not an encoded volume$"):
                kinevox.Volume(data)

    def test_an_empty_pose_is_nan(self):
        from kinevox.v1 import stream_service_pb2

        pose = kinevox.PoseFrame(stream_service_pb2.StreamPosesResponse())
        self.assertFalse(pose.found)
        self.assertEqual((pose.subjects, pose.subject_id), ((), 0))
        self.assertTrue(
            np.isnan(
                [pose.coordinates["knee_angle_r"], pose.angles["trunk_lean_geometric"], pose.contour_residual_rms_m]
            ).all()
        )
        self.assertTrue(np.isnan(pose.translations.m).all())
        self.assertTrue(np.isnan(pose.joints["toe_l"]).all() and np.isnan(pose.coordinates.deg).all())
        self.assertTrue(np.isnan(list(pose.ratios.values())).all())

    def test_several_subjects(self):
        from kinevox.v1 import stream_service_pb2 as pb

        message = pb.StreamPosesResponse()
        message.header.sequence = 7
        for subject_id, knee_deg in ((1, 10.0), (3, 30.0)):
            subject = message.subjects.add(subject_id=subject_id)
            subject.pose.coordinates.add(name="knee_angle_r", value_deg=knee_deg, std_deg=1.5)
            subject.pose.coordinates.add(name="knee_angle_l", withheld_reason="angle uncertain (std 20 deg)")
        message.subjects.add(subject_id=4)  # tracked, without a pose
        frame = kinevox.PoseFrame(message)
        self.assertEqual([pose.subject_id for pose in frame.subjects], [1, 3, 4])
        self.assertEqual([pose.found for pose in frame.subjects], [True, True, False])
        self.assertEqual(frame.subject(3).coordinates["knee_angle_r"], 30)
        self.assertEqual(frame.subject(3).coordinates.withheld_reason, {"knee_angle_l": "angle uncertain (std 20 deg)"})
        with self.assertRaisesRegex(kinevox.FailedPrecondition, r"several subjects are tracked \(1, 3, 4\)"):
            frame.coordinates
        table = kinevox.PoseTable.of([frame, kinevox.PoseFrame(pb.StreamPosesResponse())])
        self.assertEqual(table.subject.tolist(), [1, 3, 4, 0])
        self.assertEqual(table.subject_ids, [1, 3, 4])
        self.assertEqual(table.of_subject(3).coordinate("knee_angle_r").tolist(), [30])
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "poses.csv"
            table.write_csv(file)
            self.assertEqual(
                [line.split(",")[2] for line in file.read_text().splitlines()], ["subject", "1", "3", "4", ""]
            )

    def test_tables_of_each_subject(self):
        rows = np.arange(5.0)
        table = kinevox.PoseTable(
            np.array([7, 7, 8, 9, 10]),
            np.array([0, 0, 0.1, 0.2, 0.3]),
            np.array([1, 2, 1, 0, 2]),
            *(np.broadcast_to(rows[:, None], (5, n)).copy() for n in (1, 11, 29, 3)),
        )
        self.assertTrue(table.has_several)
        by_subject = table.by_subject()
        self.assertEqual(
            {subject: part.frame.tolist() for subject, part in by_subject.items()}, {1: [7, 8], 2: [7, 10]}
        )
        self.assertFalse(by_subject[2].has_several)
        for subject, expected in ((1, [0, 2, np.nan, np.nan]), (2, [1, np.nan, np.nan, 4])):
            part = table.of_subject(subject, every_frame=True)
            np.testing.assert_array_equal(part.time_s, [0, 0.1, 0.2, 0.3])
            np.testing.assert_array_equal(part.angles_deg[:, 0], expected)
            np.testing.assert_array_equal(part.subject, np.where(np.isnan(expected), 0, subject))
        self.assertEqual(len(table.of_subject(9)), 0)
        self.assertEqual(table.of_subject(9, every_frame=True).subject.tolist(), [0] * 4)
        np.testing.assert_array_equal(table.angles_deg[:, 0], rows)  # unchanged

    def test_lists_request_all_pages(self):
        from kinevox.calls import Call, plan
        from kinevox.v1 import recording_service_pb2 as pb

        call = Call(
            "RecordingService/ListRecordings",
            pb.ListRecordingsRequest(),
            pb.ListRecordingsResponse,
            lambda answer: [recording.name for recording in answer.recordings],
        )
        steps = plan(call, "", "a test")
        tokens = [next(steps).request.page_token]
        names = None
        for name, token in (("a", "2"), ("b", "3"), ("c", "")):
            page = pb.ListRecordingsResponse(recordings=[pb.Recording(name=name)], next_page_token=token)
            try:
                tokens.append(steps.send(page).request.page_token)
            except StopIteration as done:
                names = done.value
        self.assertEqual((tokens, names), (["", "2", "3"], ["a", "b", "c"]))

    def test_durations(self):
        from kinevox.calls import duration

        self.assertIsNone(duration(0))
        self.assertEqual((duration(1.25).seconds, duration(1.25).nanos), (1, 250_000_000))
        for value in (float("nan"), float("inf"), 1e30):
            with self.assertRaisesRegex(kinevox.InvalidArgument, "timeout_s is .*; give finite seconds"):
                duration(value, "timeout_s")

    def test_tls_mismatch_is_named(self):
        def error(details):
            return str(from_status(grpc.StatusCode.UNAVAILABLE, details, "here:1"))

        self.assertIn("give credentials", error("Socket closed"))
        self.assertIn(
            "TLS handshake with here:1 failed", error("Ssl handshake failed: SSL_ERROR_SSL: WRONG_VERSION_NUMBER")
        )
        self.assertIn("start kinevoxd", error("failed to connect to all addresses; Connection refused"))


class Encrypted(unittest.TestCase):
    """A server with TLS and a token, like a proxy."""

    def setUp(self):
        if shutil.which("openssl") is None:
            self.skipTest("openssl is not installed")
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        key, self.certificate = (Path(self.folder.name) / name for name in ("key.pem", "certificate.pem"))
        run(
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "rsa:2048",
            "-nodes",
            "-keyout",
            key,
            "-out",
            self.certificate,
            "-days",
            "2",
            "-subj",
            "/CN=studio.example",
            "-addext",
            "subjectAltName=DNS:studio.example",
        )

        def status(_, context):
            if dict(context.invocation_metadata()).get("authorization") != "Bearer open sesame":
                context.abort(grpc.StatusCode.UNAUTHENTICATED, "no such token")
            return capture_pb.GetStatusResponse(version="of the proxy")

        server = grpc.server(futures.ThreadPoolExecutor(1))
        server.add_generic_rpc_handlers(
            (
                grpc.method_handlers_generic_handler(
                    "kinevox.v1.CaptureService",
                    {
                        "GetStatus": grpc.unary_unary_rpc_method_handler(
                            status,
                            capture_pb.GetStatusRequest.FromString,
                            capture_pb.GetStatusResponse.SerializeToString,
                        )
                    },
                ),
            )
        )
        credentials = grpc.ssl_server_credentials([(key.read_bytes(), self.certificate.read_bytes())])
        self.port = server.add_secure_port("127.0.0.1:0", credentials)
        server.start()
        self.addCleanup(lambda: server.stop(None).wait())

    def client(self, **options):
        client = kinevox.Client(
            f"127.0.0.1:{self.port}",
            server_name="studio.example",
            credentials=grpc.ssl_channel_credentials(self.certificate.read_bytes()),
            **options,
        )
        self.addCleanup(client.close)
        return client

    def test_certificate_and_token(self):
        self.assertEqual(self.client(token="open sesame").status().version, "of the proxy")
        with self.assertRaisesRegex(kinevox.KinevoxError, "rejected the token .*; give Client a valid token"):
            self.client(token="barley").status()
        with self.assertRaisesRegex(kinevox.Unimplemented, "not a Kinevox daemon of this version"):
            self.client(token="open sesame").cameras()
        with self.assertRaises(kinevox.Unavailable):
            plain = kinevox.Client(f"127.0.0.1:{self.port}", timeout_s=2)
            self.addCleanup(plain.close)
            plain.status()


if __name__ == "__main__":
    unittest.main(verbosity=2)
