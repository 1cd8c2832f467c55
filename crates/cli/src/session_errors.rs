//! Exit codes and advice for errors of sessions and pictures.

use super::advice::advised;
use super::{Failure, store_errors};
use brickyard::backend::BackendError;
use brickyard::offline::OfflineError;
use brickyard::oracle::OracleError;
use brickyard::pager::PagerError;
use brickyard::render::GpuError;
use brickyard::session::SessionError;
use brickyard::software::SoftwareError;

pub(crate) fn offline_failure(error: OfflineError) -> Failure {
    match error {
        OfflineError::Session(error) => session_failure(error),
        OfflineError::Pixel { .. } => Failure::usage(advised(&error)),
        other => Failure::failed(advised(&other)),
    }
}

pub(crate) fn oracle_failure(error: OracleError) -> Failure {
    match error {
        OracleError::TooLarge { .. } => Failure::usage(advised(&error)),
        OracleError::TooLong { .. } => Failure::failed(advised(&error)),
        OracleError::Read(error) => store_errors::read_failure(&error),
    }
}

pub(crate) fn session_failure(error: SessionError) -> Failure {
    match error {
        SessionError::Camera(_)
        | SessionError::Stereo(_)
        | SessionError::Scene(_)
        | SessionError::NoOrder
        | SessionError::Precision { .. } => Failure::usage(advised(&error)),
        SessionError::Open(error) => store_errors::open_failure(&error),
        SessionError::Unreadable(_) => Failure::bad_input(error),
        // A budget, a size or a choice that fails on any machine: like a `--memory` refused by `pack`.
        SessionError::Pager(PagerError::HostMemory { .. } | PagerError::Slots { .. })
        | SessionError::Backend(
            BackendError::Gpu(
                GpuError::Budget { .. }
                | GpuError::PictureTooLarge { .. }
                | GpuError::Meshes { .. }
                | GpuError::Textures { .. },
            )
            | BackendError::Cpu(SoftwareError::Budget { .. })
            | BackendError::CpuCompositor(_),
        ) => Failure::usage(advised(&error)),
        SessionError::Pager(_)
        | SessionError::Backend(_)
        | SessionError::LostAgain { .. }
        | SessionError::NoDevice
        | SessionError::NoThread(_)
        | SessionError::Superseded => Failure::failed(advised(&error)),
    }
}
