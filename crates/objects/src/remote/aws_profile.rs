//! Credentials and settings from AWS's own files: the profile of `AWS_PROFILE`, or `default`, in `~/.aws/credentials` and `~/.aws/config`.

use configparser::ini::Ini;
use std::ffi::OsString;
use std::path::PathBuf;

/// A profile's entries that are used.
#[derive(Debug, Default, PartialEq)]
pub(super) struct AwsProfile {
    /// Key, secret, and the token of a session.
    pub(super) credentials: Option<(String, String, Option<String>)>,
    pub(super) region: Option<String>,
    pub(super) endpoint: Option<String>,
}

impl AwsProfile {
    /// The user's profile; an empty one without files.
    pub(super) fn of_user() -> Self {
        Self::by(|name| std::env::var_os(name).filter(|value| !value.is_empty()))
    }

    fn by(variable: impl Fn(&str) -> Option<OsString>) -> Self {
        let named = variable("AWS_PROFILE").map(|name| name.to_string_lossy().into_owned());
        let profile = named.clone().unwrap_or_else(|| "default".into());
        let home = variable("HOME").map(|home| PathBuf::from(home).join(".aws"));
        let file = |name: &str, file: &str| {
            let path = variable(name).map(PathBuf::from).or_else(|| Some(home.as_ref()?.join(file)))?;
            read(&path)
        };
        let (credentials, config) =
            (file("AWS_SHARED_CREDENTIALS_FILE", "credentials"), file("AWS_CONFIG_FILE", "config"));
        let in_config = if profile == "default" { profile.clone() } else { format!("profile {profile}") };
        let entry = |key: &str| {
            let of =
                |ini: &Option<Ini>, section: &str| ini.as_ref()?.get(section, key).filter(|value| !value.is_empty());
            of(&credentials, &profile).or_else(|| of(&config, &in_config))
        };
        let key = entry("aws_access_key_id").zip(entry("aws_secret_access_key"));
        let found = Self {
            credentials: key.map(|(key, secret)| (key, secret, entry("aws_session_token"))),
            region: entry("region"),
            endpoint: entry("endpoint_url"),
        };
        if named.is_some() && found == Self::default() {
            tracing::warn!(profile, "AWS_PROFILE names a profile without credentials in ~/.aws");
        }
        found
    }
}

fn read(path: &std::path::Path) -> Option<Ini> {
    let mut ini = Ini::new_cs();
    match std::fs::read_to_string(path).map_err(|error| error.to_string()).and_then(|text| ini.read(text)) {
        Ok(_) => Some(ini),
        Err(_) if !path.exists() => None,
        Err(error) => {
            tracing::warn!(path = %path.display(), error, "credentials are not read");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_is_found_by_name_in_both_files() {
        let home = tempfile::tempdir().unwrap();
        std::fs::create_dir(home.path().join(".aws")).unwrap();
        let credentials = "[default]\naws_access_key_id = A\naws_secret_access_key = a/b+c=\n\n[lab]\naws_access_key_id=B\n\
            aws_secret_access_key=b\naws_session_token=t\n";
        std::fs::write(home.path().join(".aws/credentials"), credentials).unwrap();
        let config = "[default]\nregion = eu-west-1\n# a comment\n[profile lab]\nregion = us-west-2\nendpoint_url = http://10.0.0.1:9000\n";
        std::fs::write(home.path().join(".aws/config"), config).unwrap();
        let of = |more: &[(&str, &str)]| {
            AwsProfile::by(|name| match name {
                "HOME" => Some(home.path().into()),
                _ => more.iter().find(|(n, _)| *n == name).map(|(_, value)| OsString::from(value)),
            })
        };
        let default = of(&[]);
        assert_eq!(default.credentials, Some(("A".into(), "a/b+c=".into(), None)));
        assert_eq!((default.region.as_deref(), default.endpoint), (Some("eu-west-1"), None));
        let lab = of(&[("AWS_PROFILE", "lab")]);
        assert_eq!(lab.credentials, Some(("B".into(), "b".into(), Some("t".into()))));
        assert_eq!(lab.endpoint.as_deref(), Some("http://10.0.0.1:9000"));
        assert_eq!(of(&[("AWS_PROFILE", "absent")]), AwsProfile::default());
        assert_eq!(AwsProfile::by(|_| None), AwsProfile::default());
    }
}
