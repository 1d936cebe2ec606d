//! Simulated controllers: they speak the makers' protocols on the makers' ports, move in joint space in simulated real
//! time, come to rest a little beside the target, and fail on demand.
//!
//! They are accepted by independent clients: see "Simulated controllers" in `docs/capture.md`, and
//! `tools/robot_clients.py`, which tries them.
//!
//! What they leave out: dynamics and payloads; motions other than in joint space; scripts that do more than `movej`,
//! `stopj`, `sleep` and `textmsg`; inverse kinematics; inputs and outputs, whose values are kept at rest. Joints stop at
//! once on a fault, and a program that was interrupted does not go on.

mod arm;
mod elite;
mod elite_monitor;
mod fault;
mod model;
mod repeatability;
mod server;
mod ur;
mod ur_dashboard;
mod ur_outputs;
mod ur_script;

use std::io;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;

use super::addresses::{EliteAddresses, UrAddresses};
use super::arm::Joints;
use arm::SimulatedArm;
pub use fault::{Fault, FaultFault, FaultKind};
pub use model::SimulatedModel;
pub use repeatability::{NoiseOf, Repeatability};
use server::{Simulation, Wire};

/// How a simulated controller behaves.
#[derive(Clone, Debug)]
pub struct SimulationSettings {
    /// Seed of the noise of where it comes to rest.
    pub seed: u64,
    /// What that noise depends on.
    pub noise_of: NoiseOf,
    /// Simulated seconds per second.
    pub time_scale: f64,
    /// What goes wrong, and when.
    pub faults: Vec<Fault>,
    /// Where the arm stands at first, rad; `None` for the model's own.
    pub joints: Option<Joints>,
}

impl Default for SimulationSettings {
    fn default() -> Self {
        Self { seed: 0, noise_of: NoiseOf::Motion, time_scale: 1.0, faults: Vec::new(), joints: None }
    }
}

/// A simulated controller that listens until it is dropped.
#[derive(Debug)]
pub struct SimulatedController {
    simulation: Arc<Simulation>,
    acceptors: Vec<JoinHandle<()>>,
    listening: Vec<(&'static str, SocketAddr)>,
}

/// Why a simulated controller cannot listen.
#[derive(Debug, thiserror::Error)]
#[error(
    "cannot listen on {address} ({service}): {source}; another controller may run there: choose another address"
)]
pub struct ListenFault {
    /// Host and port.
    pub address: String,
    /// What was to be served.
    pub service: &'static str,
    /// The system's word for it.
    pub source: io::Error,
}

type Handler = fn(&mut Wire) -> io::Result<()>;

impl SimulatedController {
    /// A UR5e on four ports.
    ///
    /// # Errors
    /// If a port cannot be listened on.
    pub fn ur5e(at: &UrAddresses, settings: SimulationSettings) -> Result<Self, ListenFault> {
        let services: [(&'static str, &str, Handler); 4] = [
            ("rtde", &at.rtde, ur::serve_rtde),
            ("script", &at.script, ur_script::serve),
            ("dashboard", &at.dashboard, ur_dashboard::serve),
            ("realtime", &at.realtime, ur_script::serve),
        ];
        Self::start(&SimulatedModel::UR5E, &services, settings)
    }

    /// An EC66 on two ports.
    ///
    /// # Errors
    /// If a port cannot be listened on.
    pub fn ec66(at: &EliteAddresses, settings: SimulationSettings) -> Result<Self, ListenFault> {
        let services: [(&'static str, &str, Handler); 2] =
            [("control", &at.control, elite::serve), ("monitor", &at.monitor, elite_monitor::serve)];
        Self::start(&SimulatedModel::EC66, &services, settings)
    }

    fn start(
        model: &'static SimulatedModel,
        services: &[(&'static str, &str, Handler)],
        settings: SimulationSettings,
    ) -> Result<Self, ListenFault> {
        let mut listeners = Vec::new();
        for &(service, address, handler) in services {
            let fault = |source| ListenFault { address: address.to_owned(), service, source };
            let (listener, bound) = listen(address).map_err(fault)?;
            listeners.push((service, listener, bound, handler));
        }
        let simulation = Arc::new(Simulation::new(SimulatedArm::new(model, &settings), &settings.faults));
        let listening = listeners.iter().map(|(service, _, bound, _)| (*service, *bound)).collect();
        let acceptors = listeners
            .into_iter()
            .map(|(_, listener, _, handler)| server::accept(Arc::clone(&simulation), listener, handler))
            .collect();
        Ok(Self { simulation, acceptors, listening })
    }

    /// The services and where they listen.
    pub fn listening(&self) -> &[(&'static str, SocketAddr)] {
        &self.listening
    }

    /// Where a driver finds a service of this controller; empty if it has none of that name.
    pub fn address_of(&self, service: &str) -> String {
        let found = self.listening.iter().find(|(name, _)| *name == service);
        found.map(|(_, address)| address.to_string()).unwrap_or_default()
    }
}

fn listen(address: &str) -> io::Result<(TcpListener, SocketAddr)> {
    let candidates: Vec<_> = address.to_socket_addrs()?.collect();
    let listener = TcpListener::bind(candidates.as_slice())?;
    listener.set_nonblocking(true)?;
    let bound = listener.local_addr()?;
    Ok((listener, bound))
}

impl Drop for SimulatedController {
    fn drop(&mut self) {
        self.simulation.end();
        for acceptor in self.acceptors.drain(..) {
            let _ = acceptor.join();
        }
    }
}
