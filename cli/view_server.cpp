// See view_server.h.
#include "cli/view_server.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <httplib.h>
#include <sys/socket.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "cli/failure.h"
#include "cli/view_page.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kHost[] = "127.0.0.1";
constexpr std::size_t kThreads = 48;  // each page holds one for its events, and one a request
constexpr std::size_t kLargestBody = 1 << 20;

/// 128 bits that nobody can guess.
std::string new_token() {
  std::random_device source;
  std::string token;
  for (int i = 0; i < 4; ++i) token += fmt::format("{:08x}", source());
  return token;
}

/// In a time that does not tell how much was right.
bool begins_with(const std::string& path, const std::string& prefix) {
  unsigned difference = path.size() < prefix.size();
  for (std::size_t i = 0; i < prefix.size(); ++i)
    difference |= static_cast<unsigned char>(prefix[i] ^ (i < path.size() ? path[i] : '\0'));
  return difference == 0;
}

int status_of(Fault fault) {
  if (fault == Fault::usage || fault == Fault::data) return 400;
  return fault == Fault::memory ? 413 : 500;
}

void refuse(httplib::Response& response, int status, const std::string& why) {
  response.status = status;
  response.set_content(json_answer({{"error", why}}).body, "application/json");
}

/// In a catch block.
void refuse_current(httplib::Response& response) {
  try {
    throw;
  } catch (const Refused& refused) { refuse(response, refused.status(), refused.what()); } catch (...) {
    const Error error = current_error();
    refuse(response, status_of(error.fault()), error.what());
  }
}

using Handler = std::function<Answer(const httplib::Request&)>;

/// As it is: the library would compress text with Brotli's best, which takes longer than any picture.
void send(httplib::Response& response, Answer answer) {
  for (const auto& [name, value] : answer.headers) response.set_header(name, value);
  const auto body = std::make_shared<const std::string>(std::move(answer.body));
  response.set_content_provider(body->size(), answer.type,
                                [body](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                                  return sink.write(body->data() + offset, length);
                                });
}

httplib::Server::Handler answering(const Handler& handler) {
  return [handler](const httplib::Request& request, httplib::Response& response) {
    try {
      send(response, handler(request));
    } catch (...) { refuse_current(response); }
  };
}

double time_in(const httplib::Request& request) {
  if (!request.has_param("time")) return 0;
  const std::string word = request.get_param_value("time");
  double value = 0;
  const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (problem == std::errc() && end == word.data() + word.size() && std::isfinite(value)) return value;
  throw Refused(400, "time=" + word.substr(0, 40) + ": want seconds on the log's clock");
}

Json body_of(const httplib::Request& request) {
  Json body = parse_json(request.body, "the request");
  if (!body.is_object()) throw Refused(400, "the request: want a JSON object");
  return body;
}

/// Two servers must not share a port, as the library's own choice of options lets them.
void own_port(socket_t socket) {
  const int yes = 1;
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  fcntl(socket, F_SETFD, FD_CLOEXEC);
}

}  // namespace

class ViewServer::Service {
 public:
  Service(Shown& shown, JobQueue& jobs, Events& events, int port);
  ~Service();

  std::string address;
  int port = 0;
  std::atomic<bool> quit = false;

 private:
  void get(const std::string& path, const Handler& handler);
  void post(const std::string& path, const Handler& handler);
  void add_views();
  void add_actors();
  void stream_events();
  Answer on_device(Urgency urgency, const std::function<Answer()>& make);
  Answer frame(const Json& body);

  Shown& shown_;
  JobQueue& jobs_;
  Events& events_;
  const std::string root_ = "/" + new_token() + "/";
  httplib::Server server_;
  std::atomic<bool> deaf_ = false;  // it listens no more
  std::thread listener_;
};

ViewServer::Service::Service(Shown& shown, JobQueue& jobs, Events& events, int wanted)
    : shown_(shown), jobs_(jobs), events_(events) {
  server_.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  server_.set_keep_alive_max_count(1);  // a page that is silent holds no thread
  server_.set_payload_max_length(kLargestBody);
  server_.set_read_timeout(5, 0);
  server_.set_write_timeout(5, 0);
  server_.set_socket_options(own_port);
  server_.set_default_headers(
      {{"Cache-Control", "no-store"}, {"Referrer-Policy", "no-referrer"}, {"X-Content-Type-Options", "nosniff"}});
  server_.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
    if (begins_with(request.path, root_)) return httplib::Server::HandlerResponse::Unhandled;
    response.status = 403;
    response.set_content("This address lacks the viewer's token: use the one that cloam view printed.\n", "text/plain");
    return httplib::Server::HandlerResponse::Handled;
  });
  server_.set_error_handler([](const httplib::Request& request, httplib::Response& response) {
    if (!response.body.empty()) return;
    refuse(response, response.status, text("there is nothing for ", request.method, " here (", response.status, ")"));
  });
  add_views();
  add_actors();
  stream_events();
  port = wanted == 0 ? server_.bind_to_any_port(kHost) : server_.bind_to_port(kHost, wanted) ? wanted : -1;
  if (port < 0)
    throw Error(Fault::usage, text("--port ", wanted,
                                   ": another program has this port\n  fix: name another one, or leave --port out"));
  address = text("http://", kHost, ":", port, root_);
  listener_ = std::thread([this] {
    server_.listen_after_bind();
    deaf_ = true;
  });
}

ViewServer::Service::~Service() {
  jobs_.close();
  events_.end("the viewer has ended");
  while (!server_.is_running() && !deaf_) std::this_thread::yield();  // else stop() would find nothing to stop
  server_.stop();
  listener_.join();
}

void ViewServer::Service::get(const std::string& path, const Handler& handler) {
  server_.Get(root_ + path, answering(handler));
}

void ViewServer::Service::post(const std::string& path, const Handler& handler) {
  server_.Post(root_ + path, answering(handler));
}

Answer ViewServer::Service::on_device(Urgency urgency, const std::function<Answer()>& make) {
  return jobs_.add({urgency, "", 0, [make](const auto&) { return make(); }}).get();
}

Answer ViewServer::Service::frame(const Json& body) {
  const FrameRequest request = frame_request(body, shown_.log());
  const Urgency urgency = request.level == 0 ? Urgency::coarse : request.level == 1 ? Urgency::middle : Urgency::fine;
  return jobs_
      .add({urgency, request.client, request.number,
            [this, request](const std::function<void()>& between) { return shown_.frame(request, between); }})
      .get();
}

void ViewServer::Service::add_views() {
  get("", [](const httplib::Request&) { return Answer{viewer_page(), "text/html; charset=utf-8"}; });
  get("scene.json", [this](const auto&) { return on_device(Urgency::quick, [this] { return shown_.scene(); }); });
  get("splats.ply",
      [this](const auto&) { return on_device(Urgency::quick, [this] { return ply_answer(shown_.gaussians()); }); });
  post("frame", [this](const httplib::Request& request) { return frame(body_of(request)); });
  get(R"(photos/(\d{1,9}))",
      [this](const httplib::Request& request) { return shown_.photo(std::stoul(request.matches[1].str())); });
  get("lidar", [this](const httplib::Request& request) { return shown_.lidar(time_in(request)); });
  post("quit", [this](const auto&) {
    quit = true;
    return json_answer({{"end", "the viewer has ended"}});
  });
}

void ViewServer::Service::add_actors() {
  get("actors", [this](const httplib::Request& request) {
    return on_device(Urgency::quick, [this, time = time_in(request)] { return shown_.actors(time); });
  });
  get(R"(thumbnails/([0-9-]{1,80}))", [this](const httplib::Request& request) {
    return on_device(Urgency::thumbnail, [this, name = request.matches[1].str()] { return shown_.thumbnail(name); });
  });
  const auto add = [this](const char* path, Urgency urgency, Answer (Shown::*make)(const Json&)) {
    post(path, [this, urgency, make](const httplib::Request& request) {
      return on_device(urgency, [this, make, body = body_of(request)] { return (shown_.*make)(body); });
    });
  };
  add("pick", Urgency::quick, &Shown::pick);
  add("edit", Urgency::edit, &Shown::edit);
  add("save", Urgency::edit, &Shown::save);
  post("undo", [this](const auto&) { return on_device(Urgency::edit, [this] { return shown_.undo(); }); });
}

void ViewServer::Service::stream_events() {
  server_.Get(root_ + "events", [this](const httplib::Request&, httplib::Response& response) {
    response.set_chunked_content_provider("text/event-stream",
                                          [this, seen = uint64_t{0}](std::size_t, httplib::DataSink& sink) mutable {
                                            const Events::News news = events_.after(seen);
                                            seen = news.seen;
                                            if (!sink.write(news.lines.data(), news.lines.size())) return false;
                                            if (news.is_last) sink.done();
                                            return true;
                                          });
  });
}

ViewServer::ViewServer(Shown& shown, JobQueue& jobs, Events& events, int port)
    : service_(std::make_unique<Service>(shown, jobs, events, port)) {}
ViewServer::~ViewServer() = default;

const std::string& ViewServer::address() const { return service_->address; }
int ViewServer::port() const { return service_->port; }
bool ViewServer::was_asked_to_quit() const { return service_->quit; }

}  // namespace cloam
