//! Messages of privileges that the system does not grant to a real-time thread.

use ecan_host::{
    CycleTiming, Need, Privilege, RealTimeConfig, RealTimeError, RealTimeFault, RealTimeReport,
};

#[test]
fn default_config_applies_nothing() {
    assert_eq!(RealTimeConfig::default().apply(), Ok(RealTimeReport::default()));
}

#[test]
fn every_config_fault_is_reported_and_nothing_applied() {
    let settings = RealTimeConfig {
        priority: Some(200),
        cpus: Some(Vec::new()),
        lock_memory: Some(usize::MAX),
        timing: CycleTiming { spin_ns: 1_000_001, ..CycleTiming::default() },
        ..RealTimeConfig::default()
    };
    let error = settings.apply().unwrap_err();
    let RealTimeError::Settings(faults) = &error else { panic!("{error}") };
    let expected = [
        RealTimeFault::Priority { priority: 200 },
        RealTimeFault::NoCpus,
        RealTimeFault::StackPrefault { bytes: usize::MAX },
        RealTimeFault::Spin { spin_ns: 1_000_001 },
    ];
    assert_eq!(faults.0, expected);
    let text = error.to_string();
    assert!(text.contains("priority 200 is outside 1..99"), "{text}");
    assert!(text.contains("final spin of 1000001 ns is above 1000000 ns"), "{text}");
    let zero = RealTimeConfig { priority: Some(0), ..RealTimeConfig::default() };
    assert!(zero.check().is_err());
}

#[test]
fn missing_cpu_error_lists_the_existing_cpus() {
    // 4095 is beyond the system's set; the last of the set may exist only on giant machines.
    for cpu in [4095, 1023] {
        let mut settings = RealTimeConfig { cpus: Some(vec![0, cpu]), ..RealTimeConfig::default() };
        let report = settings.apply().unwrap();
        assert!(!report.is_complete() && report.is_sufficient());
        assert_eq!(report.outcomes.len(), 1);
        assert_eq!(report.outcomes[0].privilege, Privilege::Affinity { cpus: vec![0, cpu] });
        let text = report.to_string();
        assert!(text.starts_with(&format!("CPUs 0, {cpu}: not granted, CPU")), "{text}");
        assert!(text.contains("not there, off line or kept from this process"), "{text}");
        assert!(text.contains("this thread could use "), "{text}");
        assert!(text.contains("/sys/devices/system/cpu/online"), "{text}");

        settings.cpus_need = Need::Required;
        let error = settings.apply().unwrap_err();
        let RealTimeError::Missing(same) = &error else { panic!("{error}") };
        assert_eq!(same.to_string(), text);
        assert!(error.to_string().starts_with("no real-time thread: CPUs 0, "), "{error}");
    }
}

#[test]
fn current_cpu_is_granted() {
    let text = std::fs::read_to_string("/proc/thread-self/status").unwrap();
    let line = text.lines().find(|line| line.starts_with("Cpus_allowed_list:")).unwrap();
    let list = line.split_whitespace().nth(1).unwrap();
    let first: usize = list.split([',', '-']).next().unwrap().parse().unwrap();
    let settings = RealTimeConfig {
        cpus: Some(vec![first]),
        cpus_need: Need::Required,
        ..RealTimeConfig::default()
    };
    let report = settings.apply().unwrap();
    assert!(report.is_complete());
    assert_eq!(report.to_string(), format!("CPU {first}: done"));
}

#[test]
fn priority_and_memory_are_granted_or_denied_with_a_remedy() {
    // On a thread of its own, which keeps what it is granted to its end.
    let settings = RealTimeConfig {
        priority: Some(1),
        lock_memory: Some(65_536),
        wake_up_latency_us: Some(50),
        ..RealTimeConfig::default()
    };
    let report = std::thread::spawn(move || settings.apply().unwrap()).join().unwrap();
    let lines: Vec<String> = report.outcomes.iter().map(ToString::to_string).collect();
    assert_eq!(lines.len(), 3);
    let granted = |line: &str| line.ends_with(": done");
    assert!(lines[0].starts_with("locked memory with 65536 bytes of stack: "), "{}", lines[0]);
    assert!(granted(&lines[0]) || lines[0].contains("RLIMIT_MEMLOCK"), "{}", lines[0]);
    assert!(lines[1].starts_with("processors that wake up within 50 us: "), "{}", lines[1]);
    assert!(granted(&lines[1]) || lines[1].contains("/dev/cpu_dma_latency"), "{}", lines[1]);
    assert!(lines[2].starts_with("SCHED_FIFO priority 1: "), "{}", lines[2]);
    assert!(granted(&lines[2]) || lines[2].contains("CAP_SYS_NICE"), "{}", lines[2]);
}
