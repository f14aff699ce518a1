*** Settings ***
Documentation     The USB port: a host enumerates the board, opens the port and commands it; cable, bus reset, suspend, both links.
Library           ForceBoard.py

*** Test Cases ***
A Host Enumerates The Board And Opens Its Port
    Create Log Tester    0
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    ${device}=    Descriptor    device
    Should Be Equal As Integers    ${device}[0]    18
    # 1209:0001, class 2, 8 bytes at endpoint 0.
    Should Be Equal    ${{bytes($device[4:12]).hex()}}    0200000809120100
    ${configuration}=    Descriptor    configuration
    Should Be Equal As Integers    ${{$configuration[2] | $configuration[3] << 8}}    ${{len($configuration)}}
    ${text}=    Descriptor    string2
    Should Be Equal    ${{bytes($text[2:]).decode('utf-16-le')}}    force board
    Use USB
    ${hello}=    Connect
    Should Be Equal As Integers    ${hello}[core_hz]    400000000
    Should Not Be In Log    (?i)usb.*(FIFO|endpoint|unhandled)    treatAsRegex=True    level=Warning

Wrong Requests Are Refused And Change Nothing
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    # A descriptor that is not there, a configuration that is not there, a class request that is not there.
    Control Transfer Should End    stalled    0x80    6    0x0900    0    18
    Control Transfer Should End    stalled    0x00    9    7    0    0
    Control Transfer Should End    stalled    0xA1    0x66    0    0    4
    Control Transfer Should End    done*    0x80    6    0x0100    0    18
    Use USB
    Connect

A Session Over USB
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Bring Up Units
    Zero Units
    Stream    1
    Arm
    Set Tensions    4    4    4    4    4    4
    Hold For    600
    Forget Samples
    Hold For    1000
    Tensions Should Be    4    0.6
    Frames Should Have No Gap
    Samples Should Be Complete    1000
    Latency Should Agree From Both Ends

A Pulled Cable Stops The Motors And A New Session Holds Again
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Bring Up Units
    Zero Units
    Arm
    Set Tensions    4    4    4    4    4    4
    Hold For    600
    Output Should Drive
    Execute Command    usbHost Plug false
    Advance    150
    Output Should Be Zero
    Host State Should Be    detached
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Board Fault Should Be    setpoints expired
    Request    ClearFaults
    Advance    50
    Arm
    Hold For    600
    Output Should Drive
    Tensions Should Be    4    0.8

Suspend And Resume
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Bring Up Units
    Execute Command    usbHost SuspendBus true
    Advance    100
    Execute Command    usbHost SuspendBus false
    Host State Should Be    open    within_ms=200
    Discard Input
    ${status}=    Status
    Should Be Equal As Integers    ${status}[fault]    0

A Bus Reset At Any Time Ends In An Open Port
    Power Up Board
    Execute Command    usbHost Plug true
    FOR    ${ms}    IN    101    30    41    180    160
        Advance    ${ms}
        Execute Command    usbHost ResetBus
    END
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    ${repeated}=    Number    usbHost Repeated
    Should Be Equal As Integers    ${repeated}    0

Set Force Through The Real Controller Over USB
    Power Up Board
    ${figures}=    Run Forcectl    set-force    0    2.5    0    --duration    2    --usb
    Should Be Equal As Integers    ${figures}[samples_lost]    0
    Should Be Equal As Integers    ${figures}[link_counters][frames_bad]    0
    Should Be Empty    ${figures}[faults]
    Should Be True    ${figures}[metrics][tip_force_rms_n] < 0.2
    Should Be True    abs(${figures}[metrics][applied_n][1] - 2.5) < 0.1
    Output Should Be Zero
