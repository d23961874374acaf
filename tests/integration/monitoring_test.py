#!/usr/bin/python3
"""The daemon's metrics, read by a real Prometheus; and whether dashboard, alerts and documentation name metrics that exist.

usage: monitoring_test.py BUILD_FOLDER [unittest options]"""
import json
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "tests/support"))
from studio_daemon import StudioDaemon  # noqa: E402

MONITORING = REPOSITORY / "deploy/monitoring"
BUILD = Path()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def fetch(url, accept="*/*"):
    with urllib.request.urlopen(urllib.request.Request(url, headers={"Accept": accept}), timeout=10) as answer:
        return answer.headers["Content-Type"], answer.read().decode()


def wait_for(what, check, limit_s=60):
    end = time.monotonic() + limit_s
    while True:
        try:
            if found := check():
                return found
        except (urllib.error.URLError, ConnectionError, OSError):
            pass
        if time.monotonic() > end:
            raise AssertionError(f"no {what} within {limit_s} s")
        time.sleep(0.1)


def families_in_the_code():
    """Names of all families that the daemon can write; counters with _total."""
    names = set()
    for kind, name in re.findall(
        r'\b(counter|gauge|histogram|count|one_counter|one_gauge)\(\s*"((?:kinevox|process)_[a-z_]+)"',
        (REPOSITORY / "server/metrics/capture_metrics.cc").read_text(),
    ):
        names.add(name + ("_total" if "count" in kind else ""))
    return names


def family(name):
    return re.sub(r"_(bucket|sum|count)$", "", name)


class Monitoring(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.port = free_port()
        cls.daemon = StudioDaemon(
            BUILD / "server/daemon/kinevoxd",
            cls.folder.name,
            size=(160, 120),
            fps=15,
            more=f'[pipeline]\nvoxel_mm = 40.0\n[metrics]\nlisten = "127.0.0.1:{cls.port}"\n',
        )
        cls.address = cls.daemon.address
        cls.url = f"http://127.0.0.1:{cls.port}/metrics"

    @classmethod
    def tearDownClass(cls):
        cls.daemon.stop()
        cls.folder.cleanup()

    def value(self, line):
        found = re.search(rf"^{re.escape(line)} (\S+)$", fetch(self.url)[1], re.MULTILINE)
        return float(found[1]) if found else None

    def test_values_follow_the_capture(self):
        wait_for("results", lambda: (self.value("kinevox_frame_sets_processed_total") or 0) > 5)
        wait_for("subject", lambda: self.value("kinevox_subjects_tracked") == 1)
        self.assertEqual(self.value('kinevox_capture_state{state="running"}'), 1)
        self.assertEqual(self.value("kinevox_source_nominal_fps"), 15)
        self.assertGreater(self.value("process_resident_memory_bytes"), 1e7)
        self.assertLess(abs(self.value("process_start_time_seconds") - time.time()), 600)
        before = self.value('kinevox_stage_duration_seconds_count{stage="total"}')
        wait_for("stage times", lambda: self.value('kinevox_stage_duration_seconds_count{stage="total"}') > before)
        self.assertGreater(self.value('kinevox_stage_duration_seconds_sum{stage="total"}'), 0)

    def test_counts_subscribers_and_latency(self):
        stream = subprocess.run(
            [BUILD / "client/cli/kinevox", "stream", "angles", "--frames", "5", "--server", self.address],
            capture_output=True,
            text=True,
            timeout=60,
        )
        self.assertEqual(stream.returncode, 0, stream.stderr)
        self.assertGreaterEqual(self.value('kinevox_stream_messages_sent_total{stream="poses"}'), 5)
        self.assertGreaterEqual(self.value('kinevox_stream_latency_seconds_count{stream="poses"}'), 5)
        wait_for("end of the subscription", lambda: self.value('kinevox_subscribers{stream="poses"}') == 0)

    def test_state_follows_stop_and_start(self):
        kinevox = BUILD / "client/cli/kinevox"
        subprocess.run([kinevox, "stop", "--server", self.address], check=True, capture_output=True)
        wait_for("stop", lambda: self.value('kinevox_capture_state{state="stopped"}') == 1)
        self.assertEqual(self.value('kinevox_capture_state{state="running"}'), 0)
        subprocess.run([kinevox, "start", "--server", self.address], check=True, capture_output=True)
        wait_for("start", lambda: self.value('kinevox_capture_state{state="running"}') == 1)

    def test_promtool_accepts_text_rules_and_config(self):
        if not shutil.which("promtool"):
            self.skipTest("promtool is not installed (Debian package prometheus)")
        kind, text = fetch(self.url)
        self.assertIn("text/plain; version=0.0.4", kind)
        lint = subprocess.run(["promtool", "check", "metrics"], input=text, capture_output=True, text=True)
        self.assertEqual(lint.returncode, 0, lint.stdout + lint.stderr)
        for command in (["rules", MONITORING / "alerts.yml"], ["config", MONITORING / "prometheus.yml"]):
            check = subprocess.run(["promtool", "check", *command], capture_output=True, text=True)
            self.assertEqual(check.returncode, 0, check.stdout + check.stderr)

    def test_prometheus_scrapes_the_endpoint(self):
        if not shutil.which("prometheus"):
            self.skipTest("Prometheus is not installed (Debian package prometheus)")
        wait_for("results", lambda: (self.value("kinevox_frame_sets_processed_total") or 0) > 5)
        port = free_port()
        config = Path(self.folder.name) / "prometheus.yml"
        config.write_text(
            (MONITORING / "prometheus.yml")
            .read_text()
            .replace("127.0.0.1:9464", f"127.0.0.1:{self.port}")
            .replace("scrape_interval: 5s", "scrape_interval: 1s")
            .replace("evaluation_interval: 5s", "evaluation_interval: 1s")
            .replace("alerts.yml", str(MONITORING / "alerts.yml"))
        )
        log = open(Path(self.folder.name) / "prometheus.log", "w+")
        prometheus = subprocess.Popen(
            [
                "prometheus",
                f"--config.file={config}",
                f"--storage.tsdb.path={self.folder.name}/data",
                f"--web.listen-address=127.0.0.1:{port}",
            ],
            stdout=log,
            stderr=log,
        )
        try:

            def query(expression):
                answer = fetch(
                    f"http://127.0.0.1:{port}/api/v1/query?" + urllib.parse.urlencode({"query": expression})
                )[1]
                return [(each["metric"], float(each["value"][1])) for each in json.loads(answer)["data"]["result"]]

            wait_for("scrape", lambda: query("kinevox_frame_sets_processed_total"))
            self.assertEqual([value for _, value in query('up{job="kinevox"}')], [1])
            first = query("kinevox_frame_sets_processed_total")[0][1]
            wait_for("later scrape", lambda: query("kinevox_frame_sets_processed_total")[0][1] > first)
            wait_for("rate", lambda: query("rate(kinevox_frame_sets_processed_total[10s]) > 0"))
            targets = json.loads(fetch(f"http://127.0.0.1:{port}/api/v1/targets")[1])["data"]["activeTargets"]
            self.assertEqual([(target["health"], target["lastError"]) for target in targets], [("up", "")])
            rules = json.loads(fetch(f"http://127.0.0.1:{port}/api/v1/rules")[1])["data"]["groups"][0]["rules"]
            self.assertGreater(len(rules), 5)
            wait_for(
                "evaluation of the rules",
                lambda: all(
                    rule["health"] == "ok"
                    for rule in json.loads(fetch(f"http://127.0.0.1:{port}/api/v1/rules")[1])["data"]["groups"][0][
                        "rules"
                    ]
                ),
            )
        finally:
            prometheus.terminate()
            prometheus.wait()
            log.close()

    def test_dashboard_alerts_and_documentation_name_existing_metrics(self):
        known = families_in_the_code()
        self.assertGreater(len(known), 30)
        written = set(re.findall(r"^# TYPE (\S+)", fetch(self.url)[1], re.MULTILINE))
        self.assertLessEqual(written, known, "written, but not found in the code by this test")
        dashboard = (MONITORING / "grafana-dashboard.json").read_text()
        for name, text in (("dashboard", dashboard), ("alerts", (MONITORING / "alerts.yml").read_text())):
            used = {family(each) for each in re.findall(r"\b(?:kinevox|process)_[a-z_]+", text)}
            self.assertGreater(len(used), 5)
            self.assertLessEqual(used, known, name)
        page = (REPOSITORY / "docs/monitoring.md").read_text()
        self.assertEqual(set(re.findall(r"^\| `((?:kinevox|process)_[a-z_]+)", page, re.MULTILINE)), known)

    def test_dashboard_matches_its_script(self):
        made = subprocess.run([MONITORING / "make-dashboard"], capture_output=True, text=True, check=True).stdout
        self.assertEqual(made, (MONITORING / "grafana-dashboard.json").read_text())


if __name__ == "__main__":
    BUILD = Path(sys.argv.pop(1)).resolve()
    unittest.main()
