#include "client/viewer/calibration.h"

#include <utility>

namespace kinevox::viewer {
namespace {

constexpr std::chrono::milliseconds kRetryPause{500};

std::string in_use_words(const std::string& id, bool in_use) {
    return (id.empty() ? "the source's own calibration" : "calibration " + id) +
           (in_use ? " is in use" : " will be used from the next start on");
}

}  // namespace

Calibration::Calibration(client::ClientOptions options)
    : options_(std::move(options)), commands_(options_), pages_(options_) {
    for (const Commands* commands : {&commands_, &pages_}) {
        connect(commands, &Commands::done, this, &Calibration::done, Qt::DirectConnection);
        connect(commands, &Commands::failed, this, &Calibration::failed, Qt::DirectConnection);
    }
}

Calibration::~Calibration() {
    watch(false);
    std::shared_ptr<CalibrationRun> run;
    changed([&] { run = run_; });
    if (run) run->stop();
}

void Calibration::changed(const std::function<void()>& change) {
    const std::scoped_lock lock(mutex_);
    change();
}

bool Calibration::running() const {
    const std::scoped_lock lock(mutex_);
    return running_;
}

CalibrationStep Calibration::step() const {
    const std::scoped_lock lock(mutex_);
    return step_;
}

std::string Calibration::lack() const {
    const std::scoped_lock lock(mutex_);
    return lack_;
}

v1::WatchProcedureResponse Calibration::progress() const {
    const std::scoped_lock lock(mutex_);
    return progress_;
}

v1::ListCalibrationsResponse Calibration::stored() const {
    const std::scoped_lock lock(mutex_);
    return stored_;
}

ShownCertificate Calibration::certificate() const {
    const std::scoped_lock lock(mutex_);
    return certificate_;
}

void Calibration::watch(bool on) {
    if (on == watching_.joinable()) return;
    if (on) {
        watching_ = std::jthread([this](const std::stop_token& stop) { watch_all(stop); });
    } else {
        watching_.request_stop();
        watching_ = {};
    }
}

void Calibration::watch_all(const std::stop_token& stop) {
    client::Client client(options_);
    std::mutex waiting;
    std::condition_variable_any wake;
    while (!stop.stop_requested()) {
        client
            .watch_procedure(
                [this](const v1::WatchProcedureResponse& progress) {
                    changed([&] { progress_ = progress; });
                    emit progress_came();
                    return true;
                },
                {.reconnect = true, .on_reconnect = {}, .stop = stop})
            .IgnoreError();  // the status line says what is wrong with the daemon
        std::unique_lock lock(waiting);
        wake.wait_for(lock, stop, kRetryPause, [] { return false; });
    }
}

bool Calibration::begin(const CalibrationPlan& plan) {
    if (running()) return false;
    const auto run = std::make_shared<CalibrationRun>(
        plan,
        [this](CalibrationStep step) {
            changed([&] {
                step_ = step;
                if (step != CalibrationStep::kMoving) lack_.clear();
            });
            emit progress_came();
        },
        [this](const v1::WatchProcedureResponse& progress) {
            changed([&] { progress_ = progress; });
            emit progress_came();
        },
        [this](const std::string& lack) { changed([&] { lack_ = lack; }); });
    changed([&] {
        run_ = run;
        running_ = true;
        lack_.clear();
    });
    running_thread_ = std::jthread([this, run] {
        client::Client client(options_);
        std::string id;
        const absl::Status status = run->run(client, kOperator, id);
        changed([this] {
            running_ = false;
            run_.reset();
        });
        emit progress_came();
        if (status.ok())
            emit solved(QString::fromStdString(id));
        else if (!absl::IsCancelled(status))
            emit failed(tr("Calibration: ") + QString::fromStdString(std::string(status.message())));
    });
    return true;
}

void Calibration::enough() {
    std::shared_ptr<CalibrationRun> run;
    changed([&] { run = run_; });
    if (run) run->enough();
}

void Calibration::cancel() {
    std::shared_ptr<CalibrationRun> run;
    changed([&] { run = run_; });
    if (run) return run->stop();
    change(tr("Cancel the calibration"), [](client::Client& c, const std::string& lease, std::string& done) {
        v1::CancelProcedureRequest request;
        request.set_lease_id(lease);
        done = "the calibration is cancelled";
        return c.cancel_procedure(request).status();
    });
}

bool Calibration::change(const QString& what,
                         std::function<absl::Status(client::Client&, const std::string&, std::string&)> act) {
    const bool taken = commands_.ask(what, [act = std::move(act)](client::Client& c, std::string& done) {
        return c.under_control(kOperator, [&](const std::string& lease) { return act(c, lease, done); });
    });
    list();  // behind it in the same queue
    return taken;
}

bool Calibration::list() {
    return commands_.ask(tr("Stored calibrations"), [this](client::Client& c, std::string&) {
        auto answer = c.list_calibrations({});
        if (!answer.ok()) return answer.status();
        changed([&] { stored_ = *std::move(answer); });
        emit stored_came();
        return absl::OkStatus();
    });
}

bool Calibration::apply(const std::string& id, bool although_bad) {
    return change(tr("Use calibration %1").arg(QString::fromStdString(id)),
                  [=](client::Client& c, const std::string& lease, std::string& done) {
                      v1::ApplyCalibrationRequest request;
                      request.set_lease_id(lease);
                      request.set_id(id);
                      request.set_restart_capture(true);
                      request.set_although_bad(although_bad);
                      const auto answer = c.apply_calibration(request);
                      if (answer.ok()) done = in_use_words(id, answer->in_use());
                      return answer.status();
                  });
}

bool Calibration::undo() {
    return change(tr("Back to the calibration before"),
                  [](client::Client& c, const std::string& lease, std::string& done) {
                      v1::UndoCalibrationRequest request;
                      request.set_lease_id(lease);
                      request.set_restart_capture(true);
                      const auto answer = c.undo_calibration(request);
                      if (answer.ok()) done = in_use_words(answer->id(), answer->in_use());
                      return answer.status();
                  });
}

bool Calibration::remove(const std::string& id) {
    return change(tr("Delete calibration %1").arg(QString::fromStdString(id)),
                  [=](client::Client& c, const std::string& lease, std::string& done) {
                      v1::RemoveCalibrationRequest request;
                      request.set_lease_id(lease);
                      request.set_id(id);
                      done = "calibration " + id + " is deleted";
                      return c.remove_calibration(request).status();
                  });
}

bool Calibration::show_certificate(const std::string& id) {
    const auto ask = [this, id](bool with_page) {
        return [this, id, with_page](client::Client& c, std::string&) {
            v1::GetCertificateRequest request;
            request.set_id(id);
            request.set_with_page(with_page);
            const auto answer = c.get_certificate(request);
            if (!answer.ok()) return answer.status();
            QImage page;
            if (with_page) page.loadFromData(QByteArray::fromStdString(answer->page_png()), "PNG");
            changed([&] { certificate_ = {id, answer->certificate(), page}; });
            emit certificate_came();
            return absl::OkStatus();
        };
    };
    return pages_.ask(tr("Certificate"), ask(false)) && pages_.ask(tr("The certificate's page"), ask(true));
}

}  // namespace kinevox::viewer
