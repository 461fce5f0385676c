//! The command line: options, and the functions of the commands.

mod calibrate;
#[cfg(all(feature = "v4l2", target_os = "linux"))]
mod check;
#[cfg(all(feature = "v4l2", target_os = "linux"))]
mod devices;
#[cfg(feature = "mdns")]
mod discover;
mod lens;
mod log;
mod plan;
mod program;
#[cfg(all(feature = "v4l2", target_os = "linux"))]
mod record;
mod settings;

#[cfg(feature = "mdns")]
use crate::announce;
use crate::machine;
use crate::memory;
use crate::pipeline::Pipeline;
use crate::probe::{Config, Link, Probe};
#[cfg(any(feature = "osc", feature = "mqtt"))]
use crate::senders::Sender;
use crate::server::{self, Event, KnownHosts, Limits, Options, Running, Signals};
use crate::source::{self, Library, Spec};
use crate::systemd;
use crate::timing::read_budgets;
use crate::usage::{self, Explained};
use clap::{Args, Parser, Subcommand};
use hemilux_core::wire::STAGES;
use plan::ServePlan;
use std::ffi::OsString;
use std::io::{self, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::time::Duration;

const EXAMPLES: &str = "\
Examples:
  hemilux                                        the built-in room on http://127.0.0.1:8080/
  hemilux serve --source scene:sky --lights 32   another scene, fewer lights
  hemilux --source env:hall.exr,view=whole       an HDR map, or a folder of maps in turn
  hemilux --source replay:recordings/office      a recorded burst or sequence, repeated
  hemilux devices                                the cameras with their formats and controls
  hemilux --source v4l2:/dev/video0,lens=lens.toml            a camera
  hemilux record --bursts 20 --out field         raw frames of a camera, for a replay
  hemilux --listen 127.0.0.1:0                   any free port; the first line on stdout contains it
  hemilux --listen 0.0.0.0:8080 --token-file hemilux.token   for the network; changes and pictures need the token
  hemilux --listen 0.0.0.0:8080 --open           for all clients of the network, with changes and pictures
  hemilux --config hemilux.toml                  options and settings of a file, which options override
  hemilux --plan --lights 20000                  memory of this configuration
  curl http://127.0.0.1:8080/lights.json         the next frame's lights
  curl 'http://127.0.0.1:8080/change?algorithm=pharr&samples=128'
  curl 'http://127.0.0.1:8080/v1/compare?algorithm=q2tree&lights=64'   lights of another sampler for the same frame
  hemilux --budget front=30,total=60             budgets; frames over them are counted and reported
  hemilux --osc 192.168.1.9:8000,lights=8        each set also as OSC bundles
  hemilux --mqtt mqtt://user:password@broker     illuminance and state for Home Assistant
  hemilux discover                               the probes on the network

Sources: v4l2:PATH, pipe:PATH, scene:room, scene:sky, scene:lamps, scene:overcast, env:PATH, replay:DIR.
Options of env, after the path: ,view=lens (the simulated camera of the built-in scenes; the default) or ,view=whole (the whole upper
hemisphere without noise), ,every=2 (seconds for which each map of a folder stays, default 0.1).
Signals: SIGHUP reads the settings of the --config file again; SIGINT and SIGTERM end the probe.
Exit status: 0 when stopped by SIGINT or SIGTERM, 1 after a failure, 2 for wrong usage or a refused configuration file.";

/// Longest time from SIGTERM to the end of the process, which then exits even if a thread is blocked.
const STOP_TIME: Duration = Duration::from_millis(950);

/// A light probe: fisheye bursts in, directional lights out, over HTTP.
#[derive(Debug, Parser)]
#[command(name = "hemilux", version, after_help = EXAMPLES, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    log: log::LogOptions,
    #[command(flatten)]
    serve: Serve,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Compute lights from the bursts of a source and serve them over HTTP (the default command).
    #[command(after_help = EXAMPLES)]
    Serve(Box<Serve>),
    /// Calibrate: compute a lens from pictures of a chessboard, or write the chessboard.
    Calibrate(calibrate::Calibrate),
    /// Convert lens files.
    Lens(lens::Lens),
    /// List the cameras with their formats and controls, or check one camera.
    #[cfg(all(feature = "v4l2", target_os = "linux"))]
    #[command(after_help = source::camera::HELP)]
    Devices(devices::Devices),
    /// Record bursts of a camera with their raw frames.
    #[cfg(all(feature = "v4l2", target_os = "linux"))]
    #[command(after_help = source::camera::HELP)]
    Record(record::Record),
    /// List the probes on the network that were started with --announce.
    #[cfg(feature = "mdns")]
    Discover(discover::Discover),
    /// Write completions for a shell to stdout.
    Completions(program::Completions),
    /// Write the man pages of all commands.
    Man(program::Man),
}

#[derive(Clone, Debug, Args)]
struct Serve {
    /// Source of bursts: v4l2:PATH, pipe:PATH, scene:NAME, env:PATH (an HDR map or a folder of maps) or replay:DIR [default: scene:room].
    #[arg(long, value_parser = str::parse::<Spec>)]
    source: Option<Spec>,
    /// Address and port to listen on; port 0 is any free one [default: 127.0.0.1:8080].
    #[arg(long, value_name = "ADDR:PORT", value_parser = address)]
    listen: Option<SocketAddr>,
    /// Allow --listen beyond this machine without a token: every client that reaches the port may read and change all settings.
    #[arg(long, conflicts_with = "token_file")]
    open: bool,
    /// File with the token that requests for changes and pictures must have; it is created (permissions 0600) if it does not exist.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// A further host name of this machine that requests may have in their Host header; may be given more than once.
    #[arg(long = "host", value_name = "NAME")]
    hosts: Vec<String>,
    /// Origin of another site, such as http://localhost:8000, whose pages may use the probe; may be given more than once.
    #[arg(long = "allow-origin", value_name = "ORIGIN", value_parser = origin)]
    allow_origins: Vec<String>,
    /// Address of a proxy whose headers Forwarded, or X-Forwarded-For and X-Forwarded-Proto, give the client's address; it must pass Host on.
    /// May be given more than once.
    #[arg(long = "trusted-proxy", value_name = "ADDR")]
    trusted_proxies: Vec<IpAddr>,
    /// File with a [photometric] table, by which lights are in lux; by default, that table of the source's lens file.
    #[arg(long, value_name = "FILE")]
    photometric: Option<PathBuf>,
    /// Lens file that calibrations made on the page are written to; by default, the source's lens file.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Class of light source, such as daylight, whose factor is used, where the [photometric] table has several classes.
    #[arg(long, value_name = "NAME")]
    light_class: Option<String>,
    /// Clients with the token may switch the source to any HDR map, folder of maps or recording in this folder; may be given more than once.
    #[arg(long = "library", value_name = "DIR")]
    library: Vec<PathBuf>,
    /// TOML file with these options and the settings; `PATCH /v1/config?save=1` writes the settings to it.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    settings: settings::SettingOptions,
    /// Longest times of stages, milliseconds, such as front=30,total=60: capture, front (merge and map), pyramid, sample, filter, encode and
    /// total [default: 110, 30, 6, 12, 2, 10, 60]. Each set names the stages that exceeded them; /info and /metrics count these.
    #[arg(long, value_name = "STAGE=MS,...", value_parser = read_budgets)]
    budget: Option<[Option<f32>; STAGES]>,
    /// Announce the probe on the network by mDNS, as a service of type _hemilux._tcp.
    #[cfg(feature = "mdns")]
    #[arg(long)]
    announce: bool,
    /// Send each set as OSC bundles over UDP: HOST:PORT[,lights=N][,coordinates=NAME]; may be given more than once. board/MESSAGES.md lists
    /// the OSC addresses.
    #[cfg(feature = "osc")]
    #[arg(long, value_name = "HOST:PORT")]
    osc: Vec<crate::senders::osc::Target>,
    /// Publish illuminance, colour temperature and the state of the source over MQTT, with the discovery messages of Home Assistant:
    /// mqtt://[USER:PASSWORD@]HOST[:PORT][/ID][?every=S&lux=FACTOR].
    #[cfg(feature = "mqtt")]
    #[arg(long, value_name = "URL")]
    mqtt: Option<crate::senders::mqtt::Broker>,
    /// For tests, with a --listen address of this machine alone: damage bursts, as in all=0.01,hang=0,seed=7. KIND=SHARE with the share of
    /// bursts for drop, late, torn, black, saturated, swapped, label, size, clock, vanish, hang or all; seed=N; the pauses late_s=S,
    /// gone_s=S, hang_s=S.
    #[arg(long, value_name = "KIND=SHARE,...", value_parser = str::parse::<source::FaultSpec>)]
    faults: Option<source::FaultSpec>,
    /// For tests: multiply the time of every stage by this factor, from 1 to 64.
    #[arg(long, value_name = "X", value_parser = slowdown)]
    slowdown: Option<f32>,
    /// Print the sizes of the buffers and exit.
    #[arg(long)]
    plan: bool,
}

/// The failure of a command: one line and an exit status.
#[derive(Debug, PartialEq, Eq)]
pub struct Failure {
    /// The error message: the file or option, the value that was found, and the value that was expected.
    pub line: String,
    /// 2 for wrong usage and refused contents of the configuration file, 1 for everything else.
    pub status: u8,
}

impl Failure {
    fn new(what: impl std::fmt::Display) -> Self {
        Self { line: what.to_string(), status: 1 }
    }

    fn usage(what: impl std::fmt::Display) -> Self {
        Self { line: what.to_string(), status: 2 }
    }
}

/// Runs the command in `arguments`, whose first element is the program's name.
///
/// # Errors
/// [`Failure`], with the message for stderr and the exit status.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> Result<(), Failure> {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => return explain(&error),
    };
    cli.log.start();
    match cli.command.unwrap_or_else(|| Command::Serve(Box::new(cli.serve))) {
        Command::Serve(options) => serve(&options),
        Command::Calibrate(options) => calibrate::run(&options),
        Command::Lens(options) => lens::run(&options),
        #[cfg(all(feature = "v4l2", target_os = "linux"))]
        Command::Devices(options) => devices::run(&options),
        #[cfg(all(feature = "v4l2", target_os = "linux"))]
        Command::Record(options) => record::run(&options),
        #[cfg(feature = "mdns")]
        Command::Discover(options) => discover::run(options),
        Command::Completions(options) => program::completions(&options),
        Command::Man(options) => program::man(&options),
    }
}

/// Prints help to stdout unchanged; converts every other error of the parser to a failure of one line.
fn explain(error: &clap::Error) -> Result<(), Failure> {
    match usage::explain::<Cli>(error) {
        Explained::Help(text) => say(&text),
        Explained::Refused(line) => Err(Failure::usage(line)),
    }
}

fn say(text: &str) -> Result<(), Failure> {
    say_bytes(text.as_bytes())
}

/// Writes `bytes` to stdout. A closed pipe is not a failure.
fn say_bytes(bytes: &[u8]) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(Failure::new(format!("stdout: found {e}"))),
        _ => Ok(()),
    }
}

/// Prints the addresses at which clients reach the server that listens at `bound`; the first line has the address for this machine, which
/// is returned.
fn tell_addresses(bound: SocketAddr, what: &str) -> Result<String, Failure> {
    let addresses = machine::reachable(bound);
    let first = addresses.first().copied().unwrap_or(bound).to_string();
    let others = addresses.iter().skip(1).map(|a| format!("hemilux: from other machines http://{a}/\n"));
    say(&format!("hemilux: serving http://{first}/ ({what})\n{}", others.collect::<String>()))?;
    Ok(first)
}

fn serve(options: &Serve) -> Result<(), Failure> {
    let plan = ServePlan::of(options)?;
    let open = if options.plan { source::open } else { source::open_or_wait };
    let source = plan.in_lux(plan.damaged(open(&plan.source).map_err(Failure::new)?))?;
    if options.plan {
        let settings = plan.config.pipeline;
        let pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), settings);
        return say(&memory::MemoryPlan::of(&pipeline.map_err(Failure::new)?).to_string());
    }
    let access = plan.access()?;
    let limits = Limits::default().within_descriptors();
    let limits = limits.map_err(|e| Failure::new(format!("the server: found {e}")))?;
    let listener = TcpListener::bind(plan.listen).map_err(|e| not_bound(plan.listen, &e))?;
    let Config { pipeline, .. } = &plan.config;
    let what = format!("{}, {}, {} lights", plan.source, pipeline.sampler, pipeline.lights);
    let calibration_file = plan.calibration_file();
    let probe = Probe::start(source, plan.source.public_name(), plan.config).map_err(Failure::new)?;
    let library = Library::new(plan.source.clone(), options.library.clone());
    let ServePlan { hosts, origins, proxies, file, listen, announce, .. } = plan;
    #[cfg(any(feature = "osc", feature = "mqtt"))]
    let senders = plan.peers;
    #[cfg(not(feature = "mdns"))]
    let _ = announce;
    let hosts = KnownHosts::of(listen, &hosts);
    let rules = Options { hosts, access, origins, proxies, file, calibration_file, library };
    let app = server::app(probe.link(), rules);
    let failed = |e: io::Error| Failure::new(format!("the server: found {e}, expected it to start"));
    let running = server::start(listener, app, limits).map_err(failed)?;
    let mut signals = running.signals().map_err(failed)?;
    #[cfg(any(feature = "osc", feature = "mqtt"))]
    let senders = start_senders(senders, &probe.link())?;
    let address = tell_addresses(running.address(), &what)?;
    systemd::serving(&address, &probe.link());
    #[cfg(feature = "mdns")]
    let announced = (options.announce || announce).then(|| announce::announce(running.address()));
    let event = wait(&running, &mut signals, &probe.link(), options);
    tracing::info!("stopping");
    systemd::stopping();
    end_in_time(if event == Event::Stop { 0 } else { 1 });
    #[cfg(feature = "mdns")]
    drop(announced);
    #[cfg(any(feature = "osc", feature = "mqtt"))]
    drop(senders);
    running.stop();
    let link = probe.link();
    drop(probe);
    if event == Event::Ended {
        return Err(Failure::new("the processing thread: found its end, expected it to run until SIGTERM"));
    }
    eprintln!("{}", link.durations().timings());
    Ok(())
}

/// Starts a thread for each OSC or MQTT peer.
#[cfg(any(feature = "osc", feature = "mqtt"))]
fn start_senders(peers: plan::Peers, link: &std::sync::Arc<Link>) -> Result<Vec<Sender>, Failure> {
    let failed = |e: io::Error| Failure::new(format!("a sender: found {e}, expected its thread to start"));
    let mut senders = Vec::new();
    #[cfg(feature = "osc")]
    for target in peers.osc {
        senders.push(crate::senders::osc::start(target, std::sync::Arc::clone(link)).map_err(failed)?);
    }
    #[cfg(feature = "mqtt")]
    if let Some(broker) = peers.mqtt {
        senders.push(crate::senders::mqtt::start(broker, std::sync::Arc::clone(link)).map_err(failed)?);
    }
    Ok(senders)
}

/// Waits for the end of the program. On SIGHUP, the configuration file is read again and its settings are applied.
fn wait(running: &Running, signals: &mut Signals, link: &Link, options: &Serve) -> Event {
    loop {
        match running.wait(signals, link.status().ended()) {
            Event::Reload => match plan::reload(options, link) {
                Ok(()) => tracing::info!(
                    "SIGHUP: the settings of the configuration file are in effect from the next frame"
                ),
                Err(failure) => eprintln!("hemilux: SIGHUP: {}; nothing was changed", failure.line),
            },
            end => return end,
        }
    }
}

/// Ends the process with `status` after [`STOP_TIME`], even if a camera, a client or the network blocks the shutdown.
fn end_in_time(status: i32) {
    let end = move || {
        std::thread::sleep(STOP_TIME);
        std::process::exit(status);
    };
    let _ = std::thread::Builder::new().name("hemilux-stop".into()).spawn(end);
}

fn not_bound(address: SocketAddr, error: &io::Error) -> Failure {
    Failure::new(match error.kind() {
        io::ErrorKind::AddrInUse => format!(
            "--listen {address}: found the port taken, expected a free one: choose another, as with --listen {}:0 for any",
            host(address)
        ),
        _ => format!(
            "--listen {address}: found {error}, expected an address of this machine and a port that may be used"
        ),
    })
}

/// Returns the address without its port, in the form of `--listen`: an IPv6 address stands in brackets.
fn host(address: SocketAddr) -> String {
    if address.is_ipv6() { format!("[{}]", address.ip()) } else { address.ip().to_string() }
}

fn address(text: &str) -> Result<SocketAddr, String> {
    let local = text.strip_prefix("localhost:").and_then(|port| port.parse().ok());
    let local = local.map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    local.or_else(|| text.parse().ok()).ok_or_else(|| "expected ADDR:PORT, such as 127.0.0.1:8080".into())
}

fn slowdown(text: &str) -> Result<f32, String> {
    let factor = text.parse().ok().filter(|factor| (1.0..=64.0).contains(factor));
    factor.ok_or_else(|| "expected a number from 1 to 64".into())
}

fn origin(text: &str) -> Result<String, String> {
    let rest = text.strip_prefix("http://").or_else(|| text.strip_prefix("https://"));
    let is_origin =
        rest.is_some_and(|r| !r.is_empty() && r.bytes().all(|b| b.is_ascii_graphic() && b != b'/'));
    is_origin
        .then(|| text.to_ascii_lowercase())
        .ok_or_else(|| "expected an origin, such as http://localhost:8000".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_core::SamplerKind;

    fn refused(arguments: &[&str]) -> Failure {
        let all = ["hemilux"].iter().chain(arguments);
        run(all.map(OsString::from)).expect_err("refused")
    }

    #[test]
    fn clap_accepts_the_definition_of_the_command_line() {
        <Cli as clap::CommandFactory>::command().debug_assert();
    }

    #[test]
    fn wrong_usage_is_one_line_that_names_the_option() {
        let cases: [(&[&str], &str); 19] = [
            (&["--faults", "black=2"], "'black=2'"),
            (&["--faults", "blue=0.1"], "saturated"),
            (&["--faults", "black=0.1", "--listen", "0.0.0.0:0", "--open"], "--faults"),
            (&["--slowdown", "0"], "1 to 64"),
            (&["--budget", "front"], "STAGE=MILLISECONDS"),
            (&["--budget", "front=30,lunch=60"], "'lunch=60'"),
            (&["--lights", "0"], "1 to 50000"),
            (&["--lights", "50001"], "50000"),
            (&["--lights", "many"], "'many'"),
            (&["--lights"], "--lights"),
            (&["--sampler", "q2tree", "--lights", "1"], "for 'q2tree'"),
            (&["--sampler", "guess"], SamplerKind::NAMES[0]),
            (&["--extrapolation", "all"], "none, average"),
            (&["--listen", "8080"], "ADDR:PORT"),
            (&["--listen", "0.0.0.0:0"], "--open"),
            (&["--listen", "[::]:0"], "--open"),
            (&["serve", "--source", "v4l2:/dev/video0,size=big"], "size=big"),
            (&["--source", "scene:garden"], "overcast"),
            (&["fly"], "'fly'"),
        ];
        for (arguments, named) in cases {
            let failure = refused(arguments);
            assert_eq!(failure.status, 2, "{arguments:?}: {failure:?}");
            assert!(
                failure.line.contains(named) && !failure.line.contains('\n'),
                "{arguments:?}: {failure:?}"
            );
        }
    }

    #[test]
    fn a_missing_recording_is_a_failure() {
        let failure = refused(&["--source", "replay:/nonexistent/x"]);
        assert_eq!(failure.status, 1, "{failure:?}");
        assert!(failure.line.contains("/nonexistent/x"), "{failure:?}");
    }

    #[test]
    fn an_ipv4_loopback_name_is_an_address() {
        assert_eq!(address("localhost:80").map(|a| a.to_string()), Ok("127.0.0.1:80".into()), "localhost");
        assert!(address("localhost:99999").is_err() && address("localhost").is_err(), "no port");
    }
}
