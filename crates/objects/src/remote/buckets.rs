//! Connections to hosts and buckets, by the settings and the environment.

use super::aws_profile::AwsProfile;
use super::limits::{ANSWER_WAIT, CONNECT_WAIT, MOST_AT_ONCE};
use crate::address::Address;
use crate::disk_cache::DiskCache;
use crate::settings::settings;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::{ClientOptions, ObjectStore, RetryConfig};

/// Credentials of Google's own tools, in the home folder.
const GCLOUD_FILE: &str = ".config/gcloud/application_default_credentials.json";

/// The part of the user's cache for a host or bucket, if objects are kept.
pub(super) fn cache(address: &Address) -> Option<DiskCache> {
    let settings = settings();
    let folder = settings.cache_folder.filter(|_| settings.cache_bytes > 0)?;
    // A bucket's name is another's at another service.
    let host = address.root() + &settings.endpoint.map(|endpoint| format!(" {endpoint}")).unwrap_or_default();
    let cache = DiskCache::new(&folder, &host, settings.cache_bytes);
    cache.look_once();
    Some(cache)
}

/// Connects to a host or bucket, without a request.
pub(super) fn connect(address: &Address) -> object_store::Result<Box<dyn ObjectStore>> {
    let settings = settings();
    let client = ClientOptions::new()
        .with_allow_http(true)
        .with_connect_timeout(CONNECT_WAIT)
        .with_timeout_disabled()
        .with_read_timeout(ANSWER_WAIT)
        .with_pool_max_idle_per_host(MOST_AT_ONCE);
    // Counted and made again here.
    let retry = RetryConfig { max_retries: 0, ..RetryConfig::default() };
    let Address { scheme, authority, .. } = address;
    let is_set =
        |names: &[&str]| names.iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    Ok(match scheme.as_str() {
        "s3" => {
            let mut builder = AmazonS3Builder::from_env().with_bucket_name(authority);
            // Instances' own credentials are asked for at an address of theirs, which takes seconds elsewhere: only if the environment says so.
            let mut is_signed = is_set(&[
                "AWS_ACCESS_KEY_ID",
                "AWS_WEB_IDENTITY_TOKEN_FILE",
                "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
                "AWS_CONTAINER_CREDENTIALS_FULL_URI",
            ]);
            let profile = AwsProfile::of_user();
            if let Some((key, secret, token)) = profile.credentials.filter(|_| !is_signed && !settings.no_sign_request)
            {
                builder = builder.with_access_key_id(key).with_secret_access_key(secret);
                if let Some(token) = token {
                    builder = builder.with_token(token);
                }
                is_signed = true;
            }
            builder = builder.with_skip_signature(settings.no_sign_request || !is_signed);
            let endpoint = profile.endpoint.filter(|_| !is_set(&["AWS_ENDPOINT_URL", "AWS_ENDPOINT"]));
            if let Some(endpoint) = settings.endpoint.or(endpoint) {
                builder = builder.with_endpoint(endpoint);
            }
            let region = profile.region.filter(|_| !is_set(&["AWS_REGION", "AWS_DEFAULT_REGION"]));
            if let Some(region) = settings.region.or(region) {
                builder = builder.with_region(region);
            }
            Box::new(builder.with_allow_http(true).with_client_options(client).with_retry(retry).build()?)
        }
        "gs" => {
            let mut builder = GoogleCloudStorageBuilder::from_env().with_bucket_name(authority);
            let is_signed = is_set(&[
                "GOOGLE_APPLICATION_CREDENTIALS",
                "GOOGLE_SERVICE_ACCOUNT",
                "GOOGLE_SERVICE_ACCOUNT_KEY",
                "GOOGLE_SERVICE_ACCOUNT_PATH",
            ]) || std::env::home_dir().is_some_and(|home| home.join(GCLOUD_FILE).is_file());
            builder = builder.with_skip_signature(settings.no_sign_request || !is_signed);
            if let Some(endpoint) = &settings.endpoint {
                builder = builder.with_base_url(endpoint);
            }
            Box::new(builder.with_client_options(client).with_retry(retry).build()?)
        }
        "az" => {
            let mut builder = MicrosoftAzureBuilder::from_env().with_container_name(authority);
            let is_signed = is_set(&[
                "AZURE_STORAGE_ACCOUNT_KEY",
                "AZURE_STORAGE_ACCESS_KEY",
                "AZURE_STORAGE_SAS_KEY",
                "AZURE_STORAGE_SAS_TOKEN",
                "AZURE_STORAGE_CLIENT_SECRET",
                "AZURE_STORAGE_TOKEN",
            ]);
            builder = builder.with_skip_signature(settings.no_sign_request || !is_signed);
            if let Some(endpoint) = settings.endpoint {
                builder = builder.with_endpoint(endpoint);
            }
            Box::new(builder.with_allow_http(true).with_client_options(client).with_retry(retry).build()?)
        }
        _ => {
            let url = format!("{scheme}://{authority}");
            Box::new(HttpBuilder::new().with_url(url).with_client_options(client).with_retry(retry).build()?)
        }
    })
}
