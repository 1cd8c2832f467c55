//! The window's device: the choice of its adapter, and the detection of its loss. The first adapter able to draw on the display and create a device
//! is taken. A loss is reported by the device or noticed in polling it.

use crate::guard::guarded;
use brickyard::render::{Gpu, wgpu};
use eframe::egui;
use eframe::egui_wgpu::{RenderState, WgpuSetup, WgpuSetupCreateNew};
use std::sync::{Arc, OnceLock};
use wgpu::{Adapter, DeviceType, PollType, PowerPreference, Surface};

/// The device's setup. `is_software` prefers a software adapter.
pub(crate) fn setup(is_software: bool) -> WgpuSetup {
    WgpuSetup::CreateNew(WgpuSetupCreateNew {
        device_descriptor: Arc::new(Gpu::required),
        native_adapter_selector: Some(Arc::new(move |adapters, surface| {
            let name = std::env::var("WGPU_ADAPTER_NAME").ok();
            best(adapters, name.as_deref(), is_software, |adapter| obstacle(adapter, surface))
        })),
        ..WgpuSetupCreateNew::without_display_handle()
    })
}

/// The first adapter without an obstacle, the fastest kind first. Its name must contain `name`, if given.
fn best(
    adapters: &[Adapter],
    name: Option<&str>,
    is_software: bool,
    obstacle: impl Fn(&Adapter) -> Option<String>,
) -> Result<Adapter, String> {
    let is_low = PowerPreference::from_env() == Some(PowerPreference::LowPower);
    let called = |adapter: &Adapter| adapter.get_info().name;
    let has_name =
        |adapter: &&Adapter| name.is_none_or(|name| called(adapter).to_lowercase().contains(&name.to_lowercase()));
    let mut ranked: Vec<_> = adapters.iter().filter(has_name).collect();
    if let Some(name) = name.filter(|_| ranked.is_empty()) {
        let there: Vec<_> = adapters.iter().map(called).collect();
        return Err(format!("WGPU_ADAPTER_NAME is {name}, but the adapters are: {}", listed(&there)));
    }
    ranked.sort_by_key(|adapter| rank(adapter.get_info().device_type, is_software, is_low));
    let mut obstacles = Vec::new();
    for adapter in ranked {
        match obstacle(adapter) {
            None => return Ok(adapter.clone()),
            Some(problem) => obstacles.push(format!("{} {problem}", called(adapter))),
        }
    }
    Err(listed(&obstacles))
}

fn listed(texts: &[String]) -> String {
    if texts.is_empty() { "there is no adapter".into() } else { texts.join("; ") }
}

/// Rank of a kind of adapter in the order of attempts.
fn rank(kind: DeviceType, is_software: bool, is_low: bool) -> u8 {
    match kind {
        DeviceType::Cpu if is_software => 0,
        DeviceType::IntegratedGpu if is_low => 1,
        DeviceType::DiscreteGpu => 2,
        DeviceType::IntegratedGpu => 3,
        DeviceType::VirtualGpu => 4,
        DeviceType::Other => 5,
        DeviceType::Cpu => 6,
    }
}

/// The reason an adapter cannot draw a window, if any.
fn obstacle(adapter: &Adapter, surface: Option<&Surface<'_>>) -> Option<String> {
    // Some claim to draw on the display but offer no format.
    if surface.is_some_and(|surface| surface.get_capabilities(adapter).formats.is_empty()) {
        return Some("does not draw on this display".into());
    }
    match pollster::block_on(adapter.request_device(&Gpu::required(adapter))) {
        Err(error) => Some(format!("provides no device: {error}")),
        Ok((device, queue)) => Gpu::from_device(adapter, device, queue).err().map(|error| error.to_string()),
    }
}

/// The window's device. A clone is the same device.
#[derive(Clone)]
pub(crate) struct Device {
    pub(crate) state: RenderState,
    /// The window's context, for repaints.
    pub(crate) egui: egui::Context,
    /// The reason for its loss, once it is lost.
    loss: Arc<OnceLock<String>>,
}

impl Device {
    /// Watches a window's device, and repaints the window on its loss.
    pub(crate) fn new(state: &RenderState, egui: &egui::Context) -> Self {
        let (loss, wake) = (Arc::<OnceLock<String>>::default(), egui.clone());
        let heard = loss.clone();
        state.device.set_device_lost_callback(move |reason, message| {
            heard.get_or_init(|| format!("{reason:?} {message}").trim().to_string());
            wake.request_repaint();
        });
        // Without a handler wgpu panics. Sessions catch their own errors.
        state.device.on_uncaptured_error(Arc::new(|error| tracing::error!("GPU: {error}")));
        Self { state: state.clone(), egui: egui.clone(), loss }
    }

    pub(crate) fn is_software(&self) -> bool {
        self.state.adapter.get_info().device_type == DeviceType::Cpu
    }

    /// The reason for its loss, if it is lost. Polls the device without waiting.
    pub(crate) fn lost(&self) -> Option<String> {
        let reason = match guarded(|| self.state.device.poll(PollType::Poll)) {
            Ok(Ok(_) | Err(wgpu::PollError::Timeout)) => return self.loss.get().cloned(),
            Ok(Err(error)) => error.to_string(),
            Err(panic) => panic,
        };
        Some(self.loss.get_or_init(|| reason).clone())
    }

    /// Loses it, for tests.
    pub(crate) fn lose(&self) {
        self.state.device.destroy();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_are_tried_by_their_kinds() {
        use DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, VirtualGpu};
        let first = |is_software, is_low| {
            let kinds = [Cpu, VirtualGpu, IntegratedGpu, DiscreteGpu];
            kinds.into_iter().min_by_key(|kind| rank(*kind, is_software, is_low))
        };
        assert_eq!(first(false, false), Some(DiscreteGpu));
        assert_eq!(first(false, true), Some(IntegratedGpu));
        assert_eq!(first(true, false), Some(Cpu));
    }

    #[test]
    fn what_is_in_the_way_of_all_adapters_is_said() {
        let none = best(&[], None, false, |_| None).map(|_| ());
        assert_eq!(none, Err("there is no adapter".into()));
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let Some(adapter) = adapters.first() else { return };
        let name = adapter.get_info().name;
        let is_first = |adapter: &Adapter| adapter.get_info() == adapters[0].get_info();
        assert!(best(&adapters, Some("no such"), false, |_| None).unwrap_err().contains(&name));
        let refused = |adapter: &Adapter| is_first(adapter).then(|| "is too old".to_string());
        match best(&adapters, None, false, refused) {
            Ok(other) => assert!(!is_first(&other)),
            Err(problem) => assert!(adapters.len() == 1 && problem == format!("{name} is too old"), "{problem}"),
        }
    }
}
